"""Exports in other formats, read by programs that share no code with the writers."""

from __future__ import annotations

import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armscope.cli import run
from daq.recording import Attachments, Recording, open_long, open_recording, write_table
from daq.recording.tables import write_matlab, write_parquet
from daq.recording.tables.matlab import MatlabSource
from tests.daq.recorded import LAYOUT, make_rows

N = 700


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rows of devices, in several chunks."""
    from daq.recording.recorder import Recorder

    path = tmp_path_factory.mktemp("exports") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.recorder.CHUNK_BYTES", 100_000)
        pose = "[[1.0,0,0,2],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"
        rig = f"name = 'bench'\n[tracker]\nbase_from_tracker = {pose}\n"
        with Recorder(path, LAYOUT, Attachments(rig=rig)) as recorder:
            recorder.append(make_rows(5, N))
    return path


def exported(file: Path, out: Path, *options: str) -> Recording:
    assert run(["export", str(file), "--out", str(out), *options]) == 0
    return open_recording(file)


def test_polars_reads_the_parquet(file: Path, tmp_path: Path) -> None:
    polars = pytest.importorskip("polars")
    recording = exported(file, tmp_path / "run.parquet")
    frame = polars.read_parquet(tmp_path / "run.parquet")
    np.testing.assert_array_equal(frame["t"], recording.t)
    for joint in range(3):
        for signal in ("q", "i", "qref"):
            np.testing.assert_array_equal(frame[f"{signal}{joint + 1}"], getattr(recording, signal)[:, joint])
    assert recording.xyz is not None
    np.testing.assert_array_equal(frame["x"], recording.xyz[:, 0])
    arrow = pytest.importorskip("pyarrow.parquet").read_schema(tmp_path / "run.parquet")
    assert arrow.field("i2").metadata == {b"unit": b"A"} and arrow.field("q1").metadata == {b"unit": b"rad"}


def test_scipy_reads_the_mat(file: Path, tmp_path: Path) -> None:
    from scipy.io import loadmat, whosmat

    recording = exported(file, tmp_path / "run.mat")
    found = loadmat(tmp_path / "run.mat")
    assert [(name, shape) for name, shape, _ in whosmat(tmp_path / "run.mat")][:2] == [("t", (N, 1)), ("q", (N, 3))]
    np.testing.assert_array_equal(found["t"][:, 0], recording.t)
    for signal in ("q", "i", "qref", "xyz"):
        np.testing.assert_array_equal(found[signal], getattr(recording, signal))


@pytest.mark.parametrize("to", ["ros2", "ros2-mcap"])
def test_the_bag_has_the_messages_of_the_recording(to: str, file: Path, tmp_path: Path) -> None:
    """Of sqlite3 read by sqlite3 itself, of MCAP by the mcap library; decoded by a third."""
    decoder = pytest.importorskip("mcap_ros2._dynamic")
    recording = exported(file, tmp_path / "bag", "--to", to)
    messages: dict[str, list[tuple[int, bytes]]] = {}
    if to == "ros2":
        with sqlite3.connect(next((tmp_path / "bag").glob("*.db3"))) as base:
            query = "select topics.name, timestamp, data from messages join topics on topic_id = topics.id"
            for topic, stamp, data in base.execute(query):
                messages.setdefault(topic, []).append((stamp, data))
    else:
        from mcap.reader import make_reader

        with next((tmp_path / "bag").glob("*.mcap")).open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                messages.setdefault(channel.topic, []).append((message.log_time, message.data))
    assert set(messages) == {"/joint_states", "/motor_currents", "/joint_demands", "/tracker/point"}
    from daq.recording.messages.ros2_messages import DEFINITIONS

    name = "sensor_msgs/msg/JointState"
    decode = decoder.generate_dynamic(name, DEFINITIONS[name])[name]
    for topic, array, values in [
        ("/joint_states", "position", recording.q),
        ("/motor_currents", "effort", recording.i),
    ]:
        np.testing.assert_array_equal([stamp for stamp, _ in messages[topic]], recording.wall_ns)
        np.testing.assert_array_equal([getattr(decode(data), array) for _, data in messages[topic]], values)
    assert "message_count: 2800" in (tmp_path / "bag/metadata.yaml").read_text()


def test_a_bag_comes_back(file: Path, tmp_path: Path) -> None:
    recording = exported(file, tmp_path / "bag", "--to", "ros2")
    assert run(["import", str(tmp_path / "bag"), "--out", str(tmp_path / "back.mcap")]) == 0
    back = open_recording(tmp_path / "back.mcap")
    for signal in ("q", "i", "qref", "wall_ns"):
        np.testing.assert_array_equal(getattr(back, signal), getattr(recording, signal))
    assert back.provenance["current_unit"] == "A"


@settings(max_examples=8)
@given(st.data())
def test_parquet_and_mat_come_back_to_the_last_bit(data: st.DataObject) -> None:
    rows, joints = data.draw(st.integers(2, 40)), data.draw(st.integers(1, 4))
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    signals = {"q": rng.normal(size=(rows, joints)), "i": rng.normal(size=(rows, joints)) ** 9}
    signals["i"][0, 0] = np.nan
    if data.draw(st.booleans()):
        signals["temp"] = rng.normal(size=(rows, joints))
        signals["temp"][:, 0] = np.nan
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.mcap")
        write_table(path, np.cumsum(rng.random(rows) * 0.01 + 1e-6), signals, Attachments())
        before = open_recording(path)
        for name, write in (("a.parquet", write_parquet), ("a.mat", write_matlab)):
            write(Path(folder, name), open_long(path))
            assert run(["import", str(Path(folder, name)), "--out", str(Path(folder, "back.mcap"))]) == 0
            back = open_recording(Path(folder, "back.mcap"))
            np.testing.assert_array_equal(back.time, before.time)
            for signal in signals:
                np.testing.assert_array_equal(getattr(back, signal), getattr(before, signal))


def test_no_velocity_of_a_bag_is_early_or_late(tmp_path: Path) -> None:
    """Of an imported table, in several blocks of uneven steps, against the law of its motion."""
    any_reader = pytest.importorskip("rosbags.highlevel").AnyReader
    t = np.cumsum(np.random.default_rng(5).uniform(0.8e-3, 1.2e-3, 2000))
    q = np.column_stack([np.sin(9 * t), np.cos(7 * t)])
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": q}, Attachments())
    exported(tmp_path / "run.mcap", tmp_path / "bag", "--to", "ros2")
    with any_reader([tmp_path / "bag"]) as reader:
        of = [one for one in reader.connections if one.topic == "/joint_states"]
        found = [reader.deserialize(raw, one.msgtype).velocity for one, _, raw in reader.messages(connections=of)]
    law = np.column_stack([9 * np.cos(9 * t), -7 * np.sin(7 * t)])
    # half a step late: 81 * 0.5e-3 = 0.04
    np.testing.assert_allclose(found, law, rtol=0, atol=1e-3)


def test_further_columns_of_a_mat_keep_their_names(tmp_path: Path) -> None:
    from scipy.io import loadmat, whosmat

    rng = np.random.default_rng(2)
    path, out, rows = tmp_path / "run.mcap", tmp_path / "run.mat", 20
    signals = {"q": rng.normal(size=(rows, 1)), "i": rng.normal(size=(rows, 1))}
    for extra in ({"force_x": rng.normal(size=rows), "Temperatur Öl 😀": np.full(rows, np.nan)}, {"f": np.ones(rows)}):
        write_table(path, np.arange(rows) * 0.01, signals, Attachments(), extra=extra)
        write_matlab(out, open_long(path))
        assert ("extra_names", (len(extra), 1), "cell") in whosmat(out)
        assert [str(cell[0]) for cell in loadmat(out)["extra_names"][:, 0]] == list(extra)
        assert run(["import", str(out), "--keep-extra", "--out", str(tmp_path / "back.mcap")]) == 0
        back = open_recording(tmp_path / "back.mcap")
        assert list(back.extra) == list(extra)
        for name, values in extra.items():
            np.testing.assert_array_equal(back.extra[name], values)
        path.unlink(), (tmp_path / "back.mcap").unlink()


def test_names_that_do_not_fit_the_columns_are_left_alone(tmp_path: Path) -> None:
    """Of another program: fewer names than columns, or the names of signals."""
    from scipy.io import savemat

    numbers = np.random.default_rng(3).normal(size=(20, 2))
    table = {"t": np.arange(20) * 0.01, "q": numbers[:, :1], "i": numbers[:, :1], "extra": numbers}
    for names in (["one"], ["one", "v"], ["one", "one"], ["one", "q"]):
        savemat(tmp_path / "run.mat", table | {"extra_names": np.array(names, object)})
        assert MatlabSource(tmp_path / "run.mat").names == ["t", "q1", "i1", "extra1", "extra2"]


def test_what_cannot_be_written_leaves_nothing(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "bag").mkdir()
    for out, options in (("none/a.parquet", []), ("bag", ["--to", "ros2"]), ("bag", ["--to", "mat"])):
        assert run(["export", str(file), "--out", str(tmp_path / out), *options]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["bag"]


@pytest.mark.parametrize("ending", [".xlsx", ".h5", ".JSON", ".docx", ".gz"])
def test_no_text_is_written_under_the_name_of_another_format(
    ending: str, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert run(["export", str(file), "--out", str(tmp_path / f"run{ending}")]) == 2
    assert "must end in .csv, .parquet or .mat" in capsys.readouterr().err
    assert not list(tmp_path.glob("run.*"))


def test_a_bag_for_which_the_disk_is_too_small(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr("rosbags.rosbag2.Writer.write", full)
    assert run(["export", str(file), "--out", str(tmp_path / "bag"), "--to", "ros2"]) == 2
    said = capsys.readouterr().err
    assert said == f"error: {tmp_path / 'bag'}: cannot be written: database or disk is full\n"
    assert not (tmp_path / "bag").exists()
