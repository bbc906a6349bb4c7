"""Tables of other programs: their numbers arrive, wrong ones are refused in one line."""

from __future__ import annotations

import os
import pty
import re
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from armscope.cli import run
from daq.recording import Recording, open_recording
from daq.recording.tables import Mapping, guessed, open_source, read_blocks, read_mapping
from daq.recording.tables.guess import guess
from tests.daq.foreign_tables import NAMES, START_NS, motion, write_bag, write_franka_bag

pytest.importorskip("rosbags.highlevel")
RIG = "name = 'bench'\n" + "".join(f"[[joint]]\nname = '{name}'\n" for name in NAMES)


def imported(source: Path, *options: str) -> Recording:
    out = source.parent / "imported.mcap"
    assert run(["import", str(source), "--out", str(out), *options]) == 0
    return open_recording(out)


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


RTDE = (
    "timestamp,target_q_0,target_q_1,actual_q_0,actual_q_1,actual_current_0,actual_current_1,actual_TCP_pose_0\n"
    + "".join(f"{100 + k * 0.002:.3f},{k},{-k},{k * 0.1},{k * 0.2},{k * 0.3},{k * 0.4},9\n" for k in range(30))
)


def test_ur_rtde_is_recognised_and_asked_about(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    table, saved = tmp_path / "ur.csv", tmp_path / "map.toml"
    for separator in ", ":
        table.write_text(RTDE.replace(",", separator))
        assert run(["import", str(table), "--out", str(tmp_path / "x.mcap")]) == 2
        error = capsys.readouterr().err
        assert "q = actual_q_{0}; i = actual_current_{0}" in error and "--guess accepts this" in error
        guess_ = imported(table, "--guess", "--save-map", str(saved))
        again = imported(table, "--map", str(saved))
        for one in (guess_, again):
            np.testing.assert_allclose(one.q[3], [0.3, 0.6])
            np.testing.assert_allclose(one.i[3], [0.9, 1.2])
            assert one.qref is not None and one.qref[3].tolist() == [3, -3]
            assert one.provenance["current_unit"] == "A" and one.time is not None and one.time[0] == 100.0


def test_libfranka_writes_ms_torques_and_a_name_twice(tmp_path: Path) -> None:
    names = [f"{signal}[{j}]" for signal in ("q", "q_d", "dq", "tau_J") for j in range(7)]
    header = (
        "duration, success rate, " + ", ".join(names) + ",sent commands," + ", ".join(f"q_d[{j}]" for j in range(7))
    )
    rows = [f"{k},1," + ",".join(str(k + n / 100) for n in range(28)) + ",," + ",".join("0" * 7) for k in range(1, 40)]
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, np.arange(39) * 1e-3, atol=1e-12)
    np.testing.assert_allclose(recording.q[0], 1 + np.arange(7) / 100)
    np.testing.assert_allclose(recording.i[0], 1.21 + np.arange(7) / 100)
    assert recording.qref is not None and recording.qref[0, 0] == 1.07


def test_names_of_libfranka_in_a_table_of_ones_own(tmp_path: Path) -> None:
    names = [f"{signal}[{j}]" for signal in ("q", "q_d", "tau_J") for j in range(2)]
    rows = [f"{2 * k}," + ",".join(f"{(k + n / 100) / 10:.4g}" for n in range(6)) for k in range(40)]
    (tmp_path / "log.csv").write_text("\n".join(["time_ms," + ",".join(names), *rows]))
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, np.arange(40) * 2e-3, atol=1e-12)
    assert recording.q[1].tolist() == [0.1, 0.101] and recording.i[1].tolist() == [0.104, 0.105]
    assert recording.qref is not None and recording.qref[1].tolist() == [0.102, 0.103]
    assert recording.provenance["current_unit"] == "N m"


FRANKA_STATE = ("q", "q_d", "dq", "dq_d", "tau_J", "tau_ext_hat_filtered")
FRANKA_COMMAND = {"q_d": 7, "dq_d": 7, "O_T_EE_d": 16, "O_dP_EE_d": 6, "tau_J_d": 7}
"""As libfranka's csvRobotStateHeader and csvRobotCommandHeader name them (src/log.cpp, src/logging)."""


@pytest.mark.parametrize("gap", [", ", ","], ids=["until 0.13", "since 0.14"])
def test_libfranka_log_to_csv(gap: str, tmp_path: Path) -> None:
    """With the header of logToCSV: names of an array have a blank behind their commas in older releases."""
    groups = [gap.join(f"state.{signal}[{j}]" for j in range(7)) for signal in FRANKA_STATE]
    groups += [gap.join(f"cmd.{signal}[{j}]" for j in range(count)) for signal, count in FRANKA_COMMAND.items()]
    rng = np.random.default_rng(0)
    state, command = rng.normal(size=(50, 6, 7)), rng.normal(size=(50, sum(FRANKA_COMMAND.values())))
    ms = 812_345 + np.arange(50)
    ms[20:] += 3  # lost packets
    lines = [f"time{gap}success_rate{gap}" + ",".join(groups)]
    for k in range(50):
        lines.append(
            ",".join([str(ms[k]), "0.99", *map(repr, state[k].ravel().tolist()), *map(repr, command[k].tolist())])
        )
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, (ms - ms[0]) * 1e-3, atol=1e-9)
    for ours, theirs in ((recording.q, "q"), (recording.qref, "q_d"), (recording.i, "tau_J")):
        assert ours is not None
        np.testing.assert_array_equal(ours, state[:, FRANKA_STATE.index(theirs)])
    assert recording.joints == 7 and recording.provenance["current_unit"] == "N m"
    kept = imported(tmp_path / "log.csv", "--guess", "--keep-extra")
    assert {"success_rate", "state.tau_ext_hat_filtered[6]", "cmd.O_T_EE_d[15]"} <= set(kept.extra)


def test_hdf5_under_the_name_of_mat_needs_no_header_of_matlab(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    t = np.arange(50) * 0.01
    with h5py.File(tmp_path / "log.mat", "w") as file:
        file["t"], file["q"], file["i"] = t, np.outer(t, [1.0, 2.0]), np.outer(t, [3.0, 4.0])
    recording = imported(tmp_path / "log.mat")
    np.testing.assert_array_equal(recording.i, np.outer(t, [3.0, 4.0]))


def test_joints_that_count_from_0_are_mapped_in_order_and_never_kept_as_others(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table = tmp_path / "log.csv"
    table.write_text("t,q0,q1,i0,i1\n" + "".join(f"{k / 100},{k},{-k},{k + 1},{k + 2}\n" for k in range(9)))
    out = ["--out", str(tmp_path / "imported.mcap")]
    for more in ([], ["--keep-extra"]):
        assert run(["import", str(table), *out, *more]) == 2
        said = capsys.readouterr().err
        assert "joints count from 1" in said and "q = q0, q1; i = i0, i1: --guess accepts" in said
        assert "--keep-extra" not in said
    recording = imported(table, "--guess")
    np.testing.assert_array_equal(recording.q, np.outer(np.arange(9), [1.0, -1.0]))
    np.testing.assert_array_equal(recording.i, np.arange(9)[:, None] + [1.0, 2.0])
    assert not recording.extra
    table.write_text("t,q0,q1,q2,i1,i2\n0,1,2,3,4,5\n")  # no guess
    assert run(["import", str(table), *out, "--keep-extra"]) == 2
    assert "column q0: joints count from 1" in capsys.readouterr().err


def test_a_long_text_without_newlines_is_refused_and_lines_may_end_in_cr(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table = tmp_path / "log.csv"
    table.write_text('{"t": [' + "0.001," * 20_000 + "1]}")
    assert run(["import", str(table), "--out", str(tmp_path / "x.mcap")]) == 2
    assert "log.csv: line 1: must name the columns" in capsys.readouterr().err
    rows = [f"{k / 1000:.3f},{k % 7},{k % 5}" for k in range(8000)]
    table.write_bytes("\r".join(["time,pos_1,torque_1", *rows]).encode())
    recording = imported(table, "--guess")
    np.testing.assert_array_equal(recording.q[:, 0], np.arange(8000) % 7)


@pytest.mark.parametrize("names", [["a", "b"], ["t", "q1"], ["time", "q1", "q3", "i1"], []])
def test_nothing_is_guessed_from_too_little(names: list[str]) -> None:
    assert guess(names) is None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[columns]\nt = "a"\nq = "b"', "columns.i: is missing"),
        ('decimal = ","\n[columns]\nt = "a"\nq = "b"\ni = "c"', "separator and decimal are both ','"),
        (
            '[columns]\nt = "a"\nq = "b"\ni = "c"\n[units]\nq = "furlong"',
            "units.q: 'furlong' is unknown; must be one of rad",
        ),
        (
            '[columns]\nt = "timestamp"\nq = "actual_q{0}"\ni = "x"',
            r"no column 'actual_q0'.* for q; is it 'actual_q_0'\?",
        ),
        (
            '[columns]\nt = "timestamp"\nq = "actual_q_{0}"\ni = "actual_current_{0}"\n[scale]\nq = [1.0]',
            "scale.q .* 1 entries for 2",
        ),
    ],
)
def test_wrong_mappings(text: str, complaint: str, tmp_path: Path) -> None:
    (tmp_path / "ur.csv").write_text(RTDE)
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError, match=complaint):
        mapping = read_mapping(tmp_path / "map.toml")
        list(read_blocks(open_source(tmp_path / "ur.csv", mapping=mapping), mapping=mapping))


@pytest.mark.parametrize("instants", ["seconds", "timestamps"])
def test_parquet(instants: str, tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    t, q, torque = motion(40_000, 2)
    times = arrow.array(t, arrow.timestamp("ns", "UTC")) if instants == "timestamps" else arrow.array((t - t[0]) * 1e-9)
    columns = {"t" if instants == "seconds" else "timestamp": times, "room": arrow.array(["lab"] * len(t))}
    for joint in range(2):
        columns |= {
            f"q{joint + 1}": q[:, joint],
            f"tau{joint + 1}": np.where(q[:, joint] > 2, np.nan, torque[:, joint]),
        }
    parquet.write_table(arrow.table(columns), tmp_path / "log.parquet", row_group_size=15_000)
    recording = imported(
        tmp_path / "log.parquet", "--guess", *(["--time-unit", "ns"] if instants == "timestamps" else [])
    )
    np.testing.assert_array_equal(recording.q, q)
    np.testing.assert_array_equal(recording.i, np.where(q > 2, np.nan, torque))
    np.testing.assert_allclose(recording.t, (t - t[0]) * 1e-9, rtol=1e-15)
    if instants == "timestamps":
        np.testing.assert_array_equal(recording.wall_ns, t)


@pytest.mark.parametrize("version", ["5", "7.3", "structure", "lying"])
def test_matlab(version: str, tmp_path: Path) -> None:
    t, q, torque = motion(20_000, 3)
    seconds = (t - t[0]) * 1e-9
    path = tmp_path / "log.mat"
    if version == "7.3":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file["t"], file["q"], file["i"], file["comment"] = seconds[None], q.T, torque.T, np.zeros((1, 4), np.uint16)
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128))
    else:
        from scipy.io import savemat

        columns = {"t": seconds, "q": q.T if version == "lying" else q, "i": torque}
        savemat(path, {"run": columns} if version == "structure" else columns | {"note": "made in a test"})
    recording = imported(path)
    np.testing.assert_array_equal(recording.q, q)
    np.testing.assert_array_equal(recording.i, torque)
    np.testing.assert_array_equal(recording.t, seconds)


@cache
def _content(kind: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return _sample(kind, Path(folder)).read_bytes()


def _sample(kind: str, folder: Path) -> Path:
    t, q, torque = motion(60, 2)
    path = folder / f"table.{kind}"
    if kind in ("db3", "mcap"):
        bag = {"/joint_states": (t, {"position": q, "effort": torque}, NAMES[:2])}
        write_bag(folder / "bag", bag, storage="mcap" if kind == "mcap" else "sqlite3")
        return next((folder / "bag").glob(f"*.{kind}")).rename(path)
    columns = {"t": (t - t[0]) * 1e-9, "q1": q[:, 0], "i1": torque[:, 0]}
    if kind == "parquet":
        pytest.importorskip("pyarrow.parquet").write_table(pytest.importorskip("pyarrow").table(columns), path)
    elif kind == "mat":
        pytest.importorskip("scipy.io").savemat(path, columns)
    else:
        path.write_text(RTDE)
    return path


@pytest.mark.parametrize("kind", ["db3", "mcap", "parquet", "mat", "csv"])
@settings(max_examples=15)
@given(st.data())
def test_torn_files_are_refused_in_one_line_or_read(kind: str, data: st.DataObject) -> None:
    """Cut anywhere, or with a byte changed: rows, or InputError; never another exception."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"table.{kind}")
        content = bytearray(_content(kind))
        place = data.draw(st.integers(0, len(content) - 1))
        if data.draw(st.booleans()):
            del content[place:]
        else:
            content[place] ^= data.draw(st.integers(1, 255))
        path.write_bytes(content)
        try:
            mapping = guessed(path)
            source = open_source(path, mapping=mapping)
            for block in read_blocks(source, mapping=mapping or source.mapping):
                assert np.all(np.diff(block.t) > 0)
        except InputError as error:
            assert "\n" not in str(error)


@settings(max_examples=40)
@given(st.text(max_size=300))
def test_any_text_as_a_mapping_or_a_table(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, read in (("map.toml", read_mapping), ("table.csv", guessed)):
            Path(folder, name).write_text(text, encoding="utf-8", errors="replace")
            try:
                assert isinstance(read(Path(folder, name)), Mapping | None)
            except InputError as error:
                assert "\n" not in str(error)


def test_a_guess_is_asked_about_at_a_terminal(tmp_path: Path) -> None:
    """A real terminal: 'n' imports nothing, 'y' imports."""
    (tmp_path / "ur.csv").write_text(RTDE)
    for answer, status in (("n", 2), ("y", 0)):
        terminal, other = pty.openpty()
        command = [sys.executable, "-m", "armscope", "import", "ur.csv", "--out", "run.mcap"]
        process = subprocess.Popen(command, cwd=tmp_path, stdin=other, stdout=other, stderr=other)
        os.write(terminal, answer.encode() + b"\n")
        assert process.wait(60) == status
        os.close(other)
        shown = os.read(terminal, 1 << 16).decode()
        os.close(terminal)
        assert "q = actual_q_{0}" in shown and "Is this right?" in shown
        assert (tmp_path / "run.mcap").exists() == (status == 0)


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_other_commands_say_what_a_bag_is(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    t, q, torque = motion(10)
    write_bag(tmp_path / "bag", {"/joint_states": (t, {"position": q, "effort": torque}, NAMES)}, storage="mcap")
    if name == "bag.mcap":
        shutil.copy(tmp_path / "bag/bag.mcap", tmp_path / name)
    assert run(["info", str(tmp_path / name)]) == 2
    assert re.fullmatch(r"error: .*bag.*'armscope import\b.*\n", capsys.readouterr().err)


def test_row_groups_of_parquet_are_read_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for all at once, pyarrow keeps those that have passed: memory would grow with the length of the file."""
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    t = np.arange(5000) * 1e-3
    parquet.write_table(arrow.table({"t": t, "q1": t, "i1": t}), tmp_path / "log.parquet", row_group_size=1000)
    asked, whole = [], parquet.ParquetFile.iter_batches

    def listened(self: object, *args: object, **options: object) -> object:
        asked.append(options["row_groups"])
        return whole(self, *args, **options)

    monkeypatch.setattr(parquet.ParquetFile, "iter_batches", listened)
    rows = sum(len(block) for block in read_blocks(open_source(tmp_path / "log.parquet")))
    assert rows == 5000 and asked == [[group] for group in range(5)]
