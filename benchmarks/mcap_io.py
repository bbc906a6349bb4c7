"""Writing and reading MCAP: our recorder and reader against other people's, on the same messages.

Every writer writes the same rows of a six-joint rig as the same four ROS 2 messages a row (the raw row with 6 counters
and 8 inputs, joint states, motor currents, demands), zstd-compressed with its own defaults, to the same disk, until the
file is closed. Ours waits for the disk after every chunk, the others do not. Every reader decodes all messages into
arrays by column.

* mcap-ros2-support: ``Writer.write_message`` with message objects; ``read_ros2_messages``
* template: the mcap package's writer, with message bytes prepared once and only the numbers packed into them
* foxglove-sdk: the same templates through ``Channel.log``
* rosbags: ``AnyReader`` and ``deserialize``

Run as ``python -m benchmarks.mcap_io [--json]``.
"""

from __future__ import annotations

import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import report
from daq.acquisition.rows import Rows
from daq.recording import open_recording
from daq.recording.messages import ros2_messages
from daq.recording.messages.row_format import RowFormat
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder, rows_layout

JOINTS = [f"joint{joint}" for joint in range(1, 7)]
LAYOUT = rows_layout(JOINTS, counters=[f"c{k}" for k in range(6)], inputs=[f"v{k}" for k in range(8)], demand=True)
FORM = RowFormat(LAYOUT)
OURS, THEIRS = 200_000, 10_000
"""Rows: enough for a second or so of each."""
ROUNDS = 4


def make_rows(count: int) -> Rows:
    """A smooth motion with noise, as measured: counts and volts of a converter, not white numbers."""
    random = np.random.default_rng(0)
    number = np.arange(count)
    t = number * 1e-3
    demand = np.sin(np.outer(t, np.linspace(0.5, 3.0, 6)))
    counts = np.rint((demand + random.normal(0, 1e-4, (count, 6))) * 10_000).astype(np.int64)
    volts = np.rint(random.normal(0, 3, (count, 8)) / 0.0049) * 0.0049
    zeros = np.zeros((count, 14), np.uint8)
    wall_ns = 1_700_000_000 * 10**9 + number * 1_000_000
    return Rows(number, wall_ns, wall_ns, number, counts, volts, zeros, counts / 10_000, volts[:, :6] * 2, None, demand)


def in_blocks(rows: Rows, size: int = 200) -> Iterator[Rows]:
    """As the sampler hands them over."""
    names = [name for name in rows.__dataclass_fields__ if name != "extra" and getattr(rows, name) is not None]
    for start in range(0, len(rows), size):
        yield Rows(**{name: getattr(rows, name)[start : start + size] for name in names})


def write_ours(path: Path, rows: Rows) -> None:
    with Recorder(path, LAYOUT, Attachments(), live=False) as recorder:
        for block in in_blocks(rows):
            recorder.append(block)


def fields(rows: Rows) -> list[dict[str, list]]:
    """The numbers of each topic's messages by field, as Python lists.

    Converted at once, which is the fastest way for the others.
    """
    step = np.diff(rows.wall_ns, prepend=rows.wall_ns[:1] - 1) * 1e-9
    velocity = np.diff(rows.q, axis=0, prepend=rows.q[:1]) / step[:, None]
    own = {name: getattr(rows, name).tolist() for name in ("number", "host_ns", "tick", "counts", "volts", "quality")}
    return [
        own,
        {"q": rows.q.tolist(), "velocity": velocity.tolist()},
        {"i": rows.i.tolist()},
        {"qref": rows.qref.tolist() if rows.qref is not None else []},
    ]


def packed(rows: Rows) -> Iterator[tuple[int, int, bytes]]:
    """(topic, time, message) of every row by template: one pack_into a field."""
    plans = []
    for topic, columns in zip(FORM.topics, fields(rows)):
        packers = []
        for name, values in columns.items():
            form, offset = topic.message.fields[name]
            base, length = (form[0], form[1][0]) if isinstance(form, tuple) else (form, 1)
            code = {"<i8": "q", "<f8": "d", "u1": "B"}[base]
            packers.append((struct.Struct(f"<{length}{code}").pack_into, offset, values, length > 1))
        plans.append((bytearray(topic.message.template), packers, topic.message.fields["stamp"][1]))
    stamp = struct.Struct("<iI").pack_into
    for row, wall in enumerate(rows.wall_ns.tolist()):
        for number, (message, packers, place) in enumerate(plans):
            stamp(message, place, *divmod(wall, 1_000_000_000))
            for pack_into, offset, values, many in packers:
                if many:
                    pack_into(message, offset, *values[row])
                else:
                    pack_into(message, offset, values[row])
            yield number, wall, bytes(message)


def write_template(path: Path, rows: Rows) -> None:
    from mcap.writer import Writer

    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schemas = {
            name: writer.register_schema(name, "ros2msg", ros2_messages.DEFINITIONS[name].encode())
            for name in FORM.types
        }
        channels = [writer.register_channel(topic.name, "cdr", schemas[topic.type]) for topic in FORM.topics]
        for number, wall, message in packed(rows):
            writer.add_message(channels[number], wall, message, wall)
        writer.finish()


def write_foxglove(path: Path, rows: Rows) -> None:
    import foxglove
    from foxglove import Channel, Context, Schema

    context = Context()
    with foxglove.open_mcap(path, context=context):
        channels = [
            Channel(
                topic.name,
                schema=Schema(name=topic.type, encoding="ros2msg", data=ros2_messages.DEFINITIONS[topic.type].encode()),
                message_encoding="cdr",
                context=context,
            )
            for topic in FORM.topics
        ]
        for number, wall, message in packed(rows):
            channels[number].log(message, log_time=wall)


def write_mcap_ros2(path: Path, rows: Rows) -> None:
    from mcap_ros2.writer import Writer

    with open(path, "wb") as stream, Writer(stream) as writer:
        schemas = {name: writer.register_msgdef(name, ros2_messages.DEFINITIONS[name]) for name in FORM.types}
        own, states, currents, demands = fields(rows)
        kinds = [schemas[topic.type] for topic in FORM.topics]
        names = [topic.name for topic in FORM.topics]
        for row, wall in enumerate(rows.wall_ns.tolist()):
            stamp = dict(zip(("sec", "nanosec"), divmod(wall, 1_000_000_000)))
            header = {"stamp": stamp, "frame_id": ""}
            joints = {"header": header, "name": JOINTS, "position": [], "velocity": [], "effort": []}
            messages: list[dict[str, Any]] = [
                {"stamp": stamp} | {name: values[row] for name, values in own.items()},
                joints | {"position": states["q"][row], "velocity": states["velocity"][row]},
                joints | {"effort": currents["i"][row]},
                joints | {"position": demands["qref"][row]},
            ]
            for name, kind, message in zip(names, kinds, messages):
                writer.write_message(name, kind, message, wall, wall)


def read_ours(path: Path) -> np.ndarray:
    return open_recording(path).q


def read_mcap_ros2(path: Path) -> np.ndarray:
    from mcap_ros2.reader import read_ros2_messages

    return _collected((message.channel.topic, message.ros_msg) for message in read_ros2_messages(str(path)))


def read_rosbags(path: Path) -> np.ndarray:
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        decode = reader.deserialize
        return _collected((link.topic, decode(raw, link.msgtype)) for link, _, raw in reader.messages())


def _collected(messages: Any) -> np.ndarray:
    """All numbers of all messages as arrays by column; returns the joint positions."""
    wanted = {
        "/armscope/row": ("number", "host_ns", "tick", "counts", "volts", "quality"),
        "/joint_states": ("position",),
        "/motor_currents": ("effort",),
        "/joint_demands": ("position",),
    }
    columns: dict[tuple[str, str], list] = {(topic, name): [] for topic, names in wanted.items() for name in names}
    stamps = []
    for topic, message in messages:
        for name in wanted[topic]:
            columns[topic, name].append(getattr(message, name))
        if topic == "/joint_states":
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
    np.array(stamps)
    arrays = {key: _array(values) for key, values in columns.items()}
    return arrays["/joint_states", "position"]


def _array(values: list) -> np.ndarray:
    return np.array([list(value) for value in values] if isinstance(values[0], bytes) else values)


def best_rates(work: dict[str, tuple[Callable[[], object], int]]) -> dict[str, float]:
    """Rows a second of each (work, rows), the best of several rounds in which all take turns."""
    best = dict.fromkeys(work, 0.0)
    for _ in range(ROUNDS):
        for name, (do, rows) in work.items():
            start = time.perf_counter()
            do()
            best[name] = max(best[name], rows / (time.perf_counter() - start))
    return best


def measure() -> dict[str, float]:
    many, few = make_rows(OURS), make_rows(THEIRS)
    with tempfile.TemporaryDirectory(prefix="armscope-") as folder:
        written, small = Path(folder) / "written.mcap", Path(folder) / "small.mcap"

        def writing(write: Callable[[Path, Rows], None], rows: Rows) -> tuple[Callable[[], None], int]:
            return lambda: (written.unlink(missing_ok=True), write(written, rows))[1], len(rows)

        writers = {"mcap_ros2": write_mcap_ros2, "template": write_template, "foxglove": write_foxglove}
        writes = best_rates(
            {name: writing(write, few) for name, write in writers.items()} | {"ours": writing(write_ours, many)}
        )
        size = written.stat().st_size
        write_ours(small, few)
        readers = {"mcap_ros2": read_mcap_ros2, "rosbags": read_rosbags}
        for path, rows, every in ((small, few, [*readers.values(), read_ours]), (written, many, [read_ours])):
            for read in every:
                np.testing.assert_array_equal(read(path), rows.q)
        reads = best_rates(
            {name: (partial(read, small), THEIRS) for name, read in readers.items()}
            | {"ours": (partial(read_ours, written), OURS)}
        )
    figures = {"write_bytes_per_row": size / OURS, "messages_per_row": float(len(FORM.topics))}
    for kind, rates in (("write", writes), ("read", reads)):
        figures[f"{kind}_rows_per_s"] = ours = rates.pop("ours")
        for name, value in rates.items():
            figures[f"{kind}_rows_per_s_{name}"] = value
            figures[f"{kind}_vs_{name}"] = ours / value
    return figures


if __name__ == "__main__":
    report(measure())
