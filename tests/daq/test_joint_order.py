"""Joints of a ROS 2 bag in another order than the model's, and beside those of a gripper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armscope
from armscope.cli import run
from daq.recording import open_recording
from tests.daq.foreign_tables import motion, write_bag

pytest.importorskip("rosbags.highlevel")
OWN = ("shoulder", "elbow")
PUBLISHED = ("elbow", "finger", "shoulder")


@pytest.fixture
def bag(tmp_path: Path) -> tuple[Path, np.ndarray, np.ndarray]:
    """A bag with joints in the order of the alphabet, its q (n, 2) rad and torques (n, 2) N m in the model's order."""
    t, q, torque = motion(60)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, PUBLISHED)})
    places = [PUBLISHED.index(name) for name in OWN]
    return tmp_path / "bag", q[:, places], torque[:, places]


def _refused(line: list[str], capsys: pytest.CaptureFixture) -> str:
    capsys.readouterr()
    assert run(line) == 2
    error = str(capsys.readouterr().err)
    assert error.count("\n") == 1
    return error


def test_a_model_says_which_joints_in_which_order(
    bag: tuple[Path, np.ndarray, np.ndarray], root: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path, q, torque = bag
    model, out = root / "config/starters/csv/model.toml", tmp_path / "run.mcap"
    assert run(["import", str(path), "--model", str(model), "--out", str(out)]) == 0
    assert "q = /joint_states.position.shoulder, /joint_states.position.elbow" in capsys.readouterr().err
    found = open_recording(out)
    np.testing.assert_array_equal(found.q, q)
    constants = armscope.read_model(model).joint_array("drive_constant")
    np.testing.assert_allclose(found.i * constants, torque, rtol=1e-12)
    assert found.model is not None and found.provenance["current_unit"] == "A"
    assert "--model: is for a table without a rig" in _refused(
        ["import", str(path), "--rig", str(model), "--model", str(model), "--out", str(out)], capsys
    )


def test_joints_in_another_order_are_no_joints_of_the_model(
    bag: tuple[Path, np.ndarray, np.ndarray], root: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path, out, own = bag[0], str(tmp_path / "run.mcap"), str(root / "config/starters/csv/model.toml")
    assert run(["import", str(path), "--out", out]) == 0
    said = "has the joints elbow, finger, shoulder; the model 'My arm' has shoulder, elbow, in this order"
    for line in (
        ["identify", out, "--model", own, "--out", str(tmp_path / "result")],
        ["diagnose", "--model", own, "--fit", out, "--out", str(tmp_path / "result")],
    ):
        error = _refused(line, capsys)
        assert said in error and "import it again with --model" in error
    assert not (tmp_path / "result").exists()


def test_of_two_devices_on_one_topic_the_arm_is_taken(tmp_path: Path) -> None:
    """The gripper publishes first, and as often."""
    t, q, torque = motion(60)
    write_bag(
        tmp_path / "bag",
        {
            "/gripper": (t - 9, {"position": q[:, :1], "effort": torque[:, :1]}, ("finger",)),
            "/arm": (t, {"position": q, "effort": torque}, ("a", "b", "c")),
        },
        one_topic="/joint_states",
    )
    assert run(["import", str(tmp_path / "bag"), "--out", str(tmp_path / "run.mcap")]) == 0
    found = open_recording(tmp_path / "run.mcap")
    assert list(found.layout.joints) == ["a", "b", "c"]
    np.testing.assert_array_equal(found.q, q)


def test_some_joints_of_a_model_are_not_enough(
    bag: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("name = 'bench'\n[[joint]]\nname = 'shoulder'\n[[joint]]\nname = 'wrist'\n")
    error = _refused(["import", str(bag[0]), "--rig", str(rig), "--out", str(tmp_path / "x.mcap")], capsys)
    assert "/joint_states has no joint 'wrist'; it has elbow, finger, shoulder" in error
