"""Other people's readers accept the files, and read the same numbers."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.rows import Rows
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder
from daq.recording.tables.table import write_table
from tests.daq.recorded import LAYOUT, make_rows

N = 300


@pytest.fixture(scope="module")
def rows() -> Rows:
    return make_rows(5, N)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, rows: Rows) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.recorder.CHUNK_BYTES", 100_000)
        with Recorder(path, LAYOUT, Attachments(rig='name = "bench"')) as recorder:
            recorder.append(rows)
    return path


def velocity(rows: Rows, ends: Sequence[int]) -> np.ndarray:
    """Slope of the parabola through a row and its neighbours, one row at a time; ``ends``: rows without one behind."""
    result = np.full(rows.q.shape, np.nan)
    for k in range(len(rows)):
        first = 0 if k == 0 else k - 2 if k in ends else k - 1
        seconds = (rows.wall_ns[first : first + 3] - rows.wall_ns[k]) * 1e-9
        result[k] = np.linalg.solve(np.vander(seconds, 3), rows.q[first : first + 3])[1]
    return result


def last_of_chunks(file: Path, rows: Rows) -> list[int]:
    """Rows from 0."""
    from mcap.reader import make_reader

    with open(file, "rb") as stream:
        summary = make_reader(stream).get_summary()
    return np.searchsorted(rows.wall_ns, [chunk.message_end_time for chunk in summary.chunk_indexes]).tolist()


def check_messages(file: Path, rows: Rows, messages: dict[str, list]) -> None:
    """Decoded messages by topic against the rows that were recorded."""
    names = ["joint1", "joint2", "joint3"]
    for topic in ("/joint_states", "/motor_currents", "/joint_demands", "/tracker/point"):
        stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in messages[topic]]
        np.testing.assert_array_equal(stamps, rows.wall_ns, err_msg=topic)
    states = messages["/joint_states"]
    assert all(list(message.name) == names for message in states)
    np.testing.assert_array_equal([message.position for message in states], rows.q)
    np.testing.assert_allclose(
        [message.velocity for message in states], velocity(rows, last_of_chunks(file, rows)), rtol=1e-8
    )
    np.testing.assert_allclose([message.effort for message in states], rows.i * [1.0, 2.0, 3.0])
    currents = messages["/motor_currents"]
    np.testing.assert_array_equal([message.effort for message in currents], rows.i)
    assert all(len(message.position) == len(message.velocity) == 0 for message in currents)
    np.testing.assert_array_equal([message.position for message in messages["/joint_demands"]], rows.qref)
    points = [(message.point.x, message.point.y, message.point.z) for message in messages["/tracker/point"]]
    np.testing.assert_array_equal(points, rows.points)
    assert {message.header.frame_id for message in messages["/tracker/point"]} == {"tracker"}
    for name in ("number", "host_ns", "tick", "counts", "volts", "quality"):
        values = [getattr(message, name) for message in messages["/armscope/row"]]
        values = [list(value) if isinstance(value, bytes) else value for value in values]
        np.testing.assert_array_equal(values, getattr(rows, name), err_msg=name)


def test_mcap_reads_by_its_index_and_checks_every_checksum(file: Path, rows: Rows) -> None:
    from mcap.reader import make_reader

    with open(file, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == 5 * N and summary.statistics.chunk_count >= 2
        assert set(summary.statistics.channel_message_counts.values()) == {N}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {attachment.name for attachment in reader.iter_attachments()} == {
            "rig.toml",
            "provenance.json",
            "ledger.json",
            "checksums.crc32",
        }
        assert {"armscope:ledger", "armscope:progress"} == {record.name for record in reader.iter_metadata()}
        one = [message for _, _, message in reader.iter_messages(topics=["/joint_demands"])]
    np.testing.assert_array_equal([message.log_time for message in one], rows.wall_ns)
    np.testing.assert_array_equal([message.publish_time for message in one], rows.wall_ns)
    np.testing.assert_array_equal([message.sequence for message in one], rows.number)


def test_a_message_index_points_at_its_messages(file: Path, rows: Rows) -> None:
    """What Foxglove and ros2 bag seek by: each entry's offset in the chunk is a message of that channel and time."""
    from mcap.opcode import Opcode
    from mcap.records import Chunk, MessageIndex
    from mcap.stream_reader import StreamReader, get_chunk_data_stream

    content, seen = b"", 0
    with open(file, "rb") as stream:
        for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, Chunk):
                data, length = get_chunk_data_stream(record, validate_crc=True)
                content = data.read(length)
            if isinstance(record, MessageIndex):
                for time, offset in record.records:
                    assert content[offset] == Opcode.MESSAGE
                    assert int.from_bytes(content[offset + 9 : offset + 11], "little") == record.channel_id
                    assert int.from_bytes(content[offset + 15 : offset + 23], "little") == time
                    seen += 1
    assert seen == 5 * N


def test_mcap_ros2_decodes(file: Path, rows: Rows) -> None:
    read_ros2_messages = pytest.importorskip("mcap_ros2.reader").read_ros2_messages
    messages: dict[str, list] = {}
    for message in read_ros2_messages(str(file)):
        messages.setdefault(message.channel.topic, []).append(message.ros_msg)
    check_messages(file, rows, messages)


def test_rosbags_decodes(file: Path, rows: Rows) -> None:
    any_reader = pytest.importorskip("rosbags.highlevel").AnyReader
    messages: dict[str, list] = {}
    with any_reader([file]) as reader:
        for connection, _, raw in reader.messages():
            messages.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    check_messages(file, rows, messages)


def test_our_bytes_are_those_that_rosbags_makes(file: Path) -> None:
    """Not only decodable: CDR byte for byte, padding included."""
    from mcap.reader import make_reader

    any_reader = pytest.importorskip("rosbags.highlevel").AnyReader
    with any_reader([file]) as reader, open(file, "rb") as stream:
        messages = list(make_reader(stream).iter_messages())
        assert {channel.topic for _, channel, _ in messages} == {one.topic for one in reader.connections}
        for schema, _, message in messages:
            decoded = reader.deserialize(message.data, schema.name)
            assert bytes(reader.typestore.serialize_cdr(decoded, schema.name)) == message.data


@pytest.mark.parametrize("kind", ["rows", "table"])
def test_doctor_finds_nothing(kind: str, file: Path, tmp_path: Path) -> None:
    doctor = shutil.which("pymcap-cli", path=str(Path(sys.executable).parent)) or shutil.which("pymcap-cli")
    if doctor is None:
        pytest.skip("pymcap-cli is not installed")
    if kind == "table":
        file = tmp_path / "table.mcap"
        t = np.arange(50) * 0.01
        q = np.random.default_rng(0).normal(size=(50, 2))
        write_table(file, t, {"q": q, "i": q, "xyz": q[:, [0, 1, 1]]}, Attachments(), extra={"a": t, "b": t})
    run = subprocess.run([doctor, "doctor", str(file)], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0 and "passed MCAP doctor checks" in " ".join(run.stdout.split()), run.stdout + run.stderr
    assert "warning" not in run.stdout.lower()


def test_rerun_reads_every_message(file: Path, tmp_path: Path) -> None:
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if rerun is None:
        pytest.skip("rerun is not installed")
    out = tmp_path / "run.rrd"
    subprocess.run([rerun, "mcap", "convert", str(file), "-o", str(out)], check=True, capture_output=True, timeout=60)
    run = subprocess.run([rerun, "rrd", "print", str(out)], check=True, capture_output=True, text=True, timeout=60)
    found = re.findall(r"with (\d+) rows .*? - (\S+) - data columns: \[\S*:message\]", run.stdout)
    rows_of: dict[str, int] = {}
    for count, topic in found:
        rows_of[topic] = rows_of.get(topic, 0) + int(count)
    assert rows_of.get("/armscope/row") == N, run.stdout
