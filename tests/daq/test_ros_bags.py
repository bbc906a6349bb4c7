"""ROS 2 bags: joint states arrive as they were published; what a bag lacks is said in one line."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from tests.daq.foreign_tables import NAMES, START_NS, imported, motion, write_bag, write_franka_bag

pytest.importorskip("rosbags.highlevel")
RIG = "name = 'bench'\n" + "".join(f"[[joint]]\nname = '{name}'\n" for name in NAMES)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_ros_bag_of_a_robot(storage: str, tmp_path: Path) -> None:
    """Folder and single file; effort is torque; the rig's names decide the order; another device is left out."""
    t, q, torque = motion()
    grip = t[::7] + 50_000
    bag = tmp_path / "bag"
    topics = {
        "/joint_states": (t, {"position": q, "effort": torque}, NAMES[::-1]),
        "/gripper/joint_states": (grip, {"position": np.zeros((len(grip), 1))}, ("finger",)),
    }
    write_bag(bag, topics, storage=storage, shifted_ns=3_000_000)
    (tmp_path / "rig.toml").write_text(RIG)
    for path in (bag, next(bag.glob("bag*.*"))):
        run_ = imported(path, "--rig", str(tmp_path / "rig.toml"))
        np.testing.assert_array_equal(run_.q, q[:, ::-1])
        np.testing.assert_array_equal(run_.i, torque[:, ::-1])
        np.testing.assert_array_equal(run_.wall_ns, t)
        assert run_.layout.joints == NAMES and run_.provenance["current_unit"] == "N m"
        assert abs(float(run_.provenance["epoch"]) * 1e9 - START_NS) < 1e9
    assert imported(bag).layout.joints == NAMES[::-1]


@pytest.mark.parametrize("topic", ["", "/robot_state", "/robot_state/measured_joint_state"])
def test_joint_states_inside_a_message_of_the_robot(topic: str, tmp_path: Path) -> None:
    """Franka's driver publishes measured and demanded joints as fields of one message."""
    t, q, torque = motion(60)
    write_franka_bag(tmp_path / "bag", t, q, q + 0.001, torque)
    options = ["--topic", f"/franka_robot_state_broadcaster{topic}"] if topic else []
    recording = imported(tmp_path / "bag", *options)
    np.testing.assert_array_equal(recording.q, q)
    np.testing.assert_array_equal(recording.qref, q + 0.001)
    np.testing.assert_array_equal(recording.i, torque)
    np.testing.assert_array_equal(recording.wall_ns, t)
    assert recording.layout.joints == NAMES


def test_a_joint_without_efforts_is_no_joint_of_the_arm(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A gripper among the joints, whose driver gives NaN: without a model the bag was refused."""
    t, q, torque = motion(60)
    q, torque = np.insert(q, 1, 0.0, axis=1), np.insert(torque, 1, np.nan, axis=1)
    names = (NAMES[0], "finger", *NAMES[1:])
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, names)})
    recording = imported(tmp_path / "bag")
    np.testing.assert_array_equal(recording.q, np.delete(q, 1, axis=1))
    assert recording.layout.joints == NAMES
    assert "finger of /joint_states without efforts: left out; --model names" in capsys.readouterr().err


def test_two_devices_on_one_topic_are_told_apart_by_their_joints(tmp_path: Path) -> None:
    t, q, torque = motion(40)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, NAMES)})
    both = {"/joint_states": (t, {"position": q, "effort": torque}, NAMES), "/other": (t + 9, {"position": q}, NAMES)}
    write_bag(tmp_path / "both", both)
    np.testing.assert_array_equal(imported(tmp_path / "both").q, imported(tmp_path / "bag").q)


def test_torques_become_currents_by_the_model_of_the_rig(tmp_path: Path, root: Path) -> None:
    t, q, torque = motion(50, joints=2)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, ("shoulder", "elbow"))})
    for name in ("rig.toml", "model.toml"):
        shutil.copy(root / "config/starters/csv" / name, tmp_path)
    from arm_model import read_model

    constants = [joint.drive_constant for joint in read_model(tmp_path / "model.toml").joints]
    recording = imported(tmp_path / "bag", "--rig", str(tmp_path / "rig.toml"))
    np.testing.assert_allclose(recording.i * constants, torque, rtol=1e-12)
    assert recording.provenance["current_unit"] == "A"
    np.testing.assert_allclose(efforts_of(tmp_path / "imported.mcap"), torque, rtol=1e-12)


def efforts_of(path: Path) -> np.ndarray:
    """(n, J) N m in /joint_states, as other programs find them."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        states = [one for one in reader.connections if one.topic == "/joint_states"]
        return np.array([reader.deserialize(raw, one.msgtype).effort for one, _, raw in reader.messages(states)])


def test_torques_stay_efforts_of_the_joint_states(tmp_path: Path) -> None:
    t, q, torque = motion(50)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, NAMES)})
    assert imported(tmp_path / "bag").provenance["current_unit"] == "N m"
    np.testing.assert_array_equal(efforts_of(tmp_path / "imported.mcap"), torque)


@pytest.mark.parametrize(
    ("topics", "options", "complaint"),
    [
        (
            {"/a": ("position", "effort"), "/b": ("position", "effort")},
            [],
            "several topics with joints, /a, /b; name one",
        ),
        ({"/a": ("position", "effort")}, ["--topic", "/c"], "no messages of .* on /c; it has /a"),
        ({"/joint_states": ("position",)}, [], "/joint_states has no efforts; armscope needs position and effort"),
        ({"/joint_states": ("effort",)}, [], "/joint_states has no positions"),
        ({}, [], "has no messages of sensor_msgs/msg/JointState"),
    ],
)
def test_bags_without_what_is_needed(
    topics: dict[str, tuple[str, ...]],
    options: list[str],
    complaint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
) -> None:
    t, q, _ = motion(5)
    write_bag(tmp_path / "bag", {topic: (t, dict.fromkeys(arrays, q), NAMES) for topic, arrays in topics.items()})
    assert run(["import", str(tmp_path / "bag"), "--out", str(tmp_path / "x.mcap"), *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and re.search(complaint, error), error
    assert not (tmp_path / "x.mcap").exists() and not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_other_commands_say_what_a_bag_is(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    t, q, torque = motion(10)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, NAMES)}, storage="mcap")
    if name == "bag.mcap":
        shutil.copy(tmp_path / "bag/bag.mcap", tmp_path / name)
    assert run(["info", str(tmp_path / name)]) == 2
    assert re.fullmatch(r"error: .*bag.*'armscope import\b.*\n", capsys.readouterr().err)


def test_names_that_the_bag_has_not_are_said(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A driver's own names, in the order of the alphabet: they were taken for the arm's without a word."""
    t, q, torque = motion(40)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, NAMES)})
    others = [f"{name}_x" for name in NAMES]
    (tmp_path / "rig.toml").write_text("name = 'bench'\n" + "".join(f"[[joint]]\nname = '{name}'\n" for name in others))
    imported(tmp_path / "bag", "--rig", str(tmp_path / "rig.toml"))
    said = f"/joint_states has none of the arm's joints {', '.join(others)}: joints 1 to {len(NAMES)} are"
    assert f"{said} {', '.join(NAMES)}, in this order" in capsys.readouterr().err
    (tmp_path / "rig.toml").write_text(f"name = 'bench'\n[[joint]]\nname = '{others[0]}'\n")
    assert run(["import", str(tmp_path / "bag"), "--rig", str(tmp_path / "rig.toml"), "--out", "x.mcap"]) == 2
    assert f"the arm has {others[0]} instead" in capsys.readouterr().err
