"""What a row of a recording holds, and the bytes that it becomes: one MCAP message per topic, all of fixed size.

Because every row has the same length, a chunk is an array with a structured numpy type: ``RowFormat.pack`` fills it
column by column, ``RowFormat.unpack`` is one ``frombuffer``. The layout travels as JSON in the metadata of the first
channel, which is repeated inside every chunk (and so is covered by the chunk's CRC): one intact chunk explains itself.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel
from numpy.typing import NDArray

from daq.recording.messages import cdr, ros2_messages

JOINT_TOPICS = {
    "q": ("/joint_states", "position"),
    "i": ("/motor_currents", "effort"),
    "qref": ("/joint_demands", "position"),
    "ql": ("/link_joint_states", "position"),
    "v": ("/motor_voltages", "effort"),
    "temp": ("/motor_temperatures", "effort"),
}
"""Signal of the joints -> its topic, and the array of sensor_msgs/JointState that carries it."""
POINT_TOPIC = "/tracker/point"
POSE_TOPIC, POSE_FRAME = "/base/pose", "world"
"""Pose of a floating base, for viewers, and its frame."""
POSE_COLUMNS = ("base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw")
"""Further columns of a table that are that pose, in the order of a PoseStamped."""
ROW_TOPIC = "/armscope/row"
TABLE_TOPIC = "/armscope/table"
READINGS_TOPIC = "/armscope/readings"


_DERIVED = ("velocity", "torque", "base_pose")
RECORD_HEAD = 31
"""Bytes of a message record ahead of the message: opcode, length, channel, sequence, two times."""


@dataclass(frozen=True)
class Layout:
    """The columns of a recording.

    joints    names of the joints
    signals   signal of ``JOINT_TOPICS`` -> joints that have it, numbered from 1
    raw       True: rows of devices (number, clocks, counts, volts, quality); False: lines of a table (number, t, extra)
    counters  names of the counter channels; inputs: of the analogue inputs
    points    frame of the tracker's points ('tracker' or 'base'), '' where there are none
    effort    N m/A (N/A): joint torque per motor ampere, for the effort in /joint_states; () where unknown
    extra     names of further columns: of a table, or readings of devices
    pose      True: ``POSE_COLUMNS`` are among them, and a PoseStamped carries them for viewers
    """

    joints: tuple[str, ...]
    signals: dict[str, tuple[int, ...]]
    raw: bool
    counters: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    points: str = ""
    effort: tuple[float, ...] = ()
    extra: tuple[str, ...] = ()
    pose: bool = False

    @property
    def quality_columns(self) -> int:
        """Counters, inputs, and the tracker."""
        return len(self.counters) + len(self.inputs) + bool(self.points)

    def to_json(self) -> str:
        table = {"version": 1, **asdict(self)}
        # earlier versions find the rows behind a text of just the length that they would write: without a pose, no key
        if not self.pose:
            del table["pose"]
        return json.dumps(table, separators=(",", ":"))

    @staticmethod
    def from_json(text: str) -> Layout:
        """Raises ValueError where the text is no layout of a version that we know."""
        table: dict[str, Any] = json.loads(text)
        if table.pop("version", None) != 1:
            raise ValueError("written by a newer armscope")
        signals = {name: tuple(joints) for name, joints in table.pop("signals").items()}
        lists: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in table.items()
        }
        return Layout(signals=signals, **lists)


@dataclass(frozen=True)
class Topic:
    """One message of a row: where its record begins in the row, and its channel."""

    channel: int
    name: str
    type: str
    start: int
    message: cdr.Message


class RowFormat:
    """The bytes of a row with a given layout.

    topics    the messages of a row, in the order in which they stand in it
    columns   names of the columns that are measured, not derived for viewers
    dtype     of a row: its columns by name, and of each topic k ``times{k}`` (2,) ns, ``stamp{k}``, ``sequence{k}``
    template  a row in which every number is 0
    prologue  channel record with the layout, with which every chunk begins
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.topics: list[Topic] = []
        self.template = bytearray()
        self._fields: dict[str, tuple[object, int]] = {}
        for name, type_, message in _messages(layout):
            self._add(name, type_, message)
        self.dtype = np.dtype(
            {
                "names": list(self._fields),
                "formats": [form for form, _ in self._fields.values()],
                "offsets": [offset for _, offset in self._fields.values()],
                "itemsize": len(self.template),
            }
        )

    def _add(self, name: str, type_: str, message: cdr.Message) -> None:
        start, channel = len(self.template), len(self.topics) + 1
        self.template.append(Opcode.MESSAGE)
        self.template += (22 + len(message.template)).to_bytes(8, "little") + channel.to_bytes(2, "little") + bytes(20)
        body = len(self.template)
        self.template += message.template
        self._fields[f"sequence{channel}"] = ("<u4", start + 11)
        self._fields[f"times{channel}"] = (("<u8", (2,)), start + 15)
        for field, (form, offset) in message.fields.items():
            self._fields[f"stamp{channel}" if field == "stamp" else field] = (form, body + offset)
        self.topics.append(Topic(channel, name, type_, start, message))

    @property
    def columns(self) -> list[str]:
        """Names of the columns of a row."""
        return [name for name in self._fields if name not in _DERIVED and not name[-1].isdigit()]

    @cached_property
    def prologue(self) -> bytes:
        """What every chunk of rows begins with: the record of their channel."""
        builder = RecordBuilder()
        self.channels()[0].write(builder)
        return builder.end()

    def channels(self) -> list[Channel]:
        """MCAP channels of the topics; schema ids number the types in the order of ``types``."""
        types = self.types
        channels = [
            Channel(topic.channel, topic.name, "cdr", {"offered_qos_profiles": ""}, types.index(topic.type) + 1)
            for topic in self.topics
        ]
        channels[0].metadata["layout"] = self.layout.to_json()
        return channels

    @property
    def types(self) -> list[str]:
        """Message types used, each once."""
        return list(dict.fromkeys(topic.type for topic in self.topics))

    def pack(self, columns: Mapping[str, NDArray], wall_ns: NDArray[np.int64]) -> bytearray:
        """The content of a chunk: the prologue, then n rows.

        ``columns`` must have an (n, ...) array for every column of the layout.
        """
        count = len(wall_ns)
        content = bytearray(self.prologue) + self.template * count
        rows = np.frombuffer(content, self.dtype, offset=len(self.prologue))
        stamps, sequence = cdr.stamps(wall_ns), columns["number"].astype(np.uint32)
        for topic in self.topics:
            rows[f"times{topic.channel}"] = wall_ns[:, None]
            rows[f"stamp{topic.channel}"] = stamps
            rows[f"sequence{topic.channel}"] = sequence
        for name in (*self.columns, *(name for name in _DERIVED if name in self._fields)):
            rows[name] = columns[name]
        return content

    def unpack(self, content: bytes) -> NDArray[np.void]:
        """The rows behind the channel record with which a chunk's content begins, a structured array without copying.

        That record is as long as the version that wrote it made it. ValueError: not a whole number of rows.
        """
        first = record_length(content)
        if (len(content) - first) % len(self.template):
            raise ValueError("is not a whole number of rows")
        return np.frombuffer(content, self.dtype, offset=first)

    def message_offsets(self, topic: Topic, count: int) -> NDArray[np.uint64]:
        """(count,) where the records of ``topic`` begin in a chunk's content."""
        return (len(self.prologue) + topic.start + len(self.template) * np.arange(count)).astype(np.uint64)


def record_length(content: bytes) -> int:
    """Bytes of the first record of a chunk's content: opcode, length, body."""
    (body,) = struct.unpack_from("<Q", content, 1)
    return 9 + int(body)


@lru_cache(maxsize=8)
def format_of(layout_json: str) -> RowFormat:
    """The format of a layout in JSON (made once, for the chunks of a file). ValueError: not a layout."""
    try:
        return RowFormat(Layout.from_json(layout_json))
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"not a layout: {error}") from None


def _messages(layout: Layout) -> list[tuple[str, str, cdr.Message]]:
    """Topic, type and bytes of each message of a row. Ours comes first."""
    if layout.raw:
        row = ros2_messages.row(len(layout.counters), len(layout.inputs), layout.quality_columns)
        messages = [(ROW_TOPIC, ros2_messages.ROW, row)]
        if layout.extra:
            messages.append((READINGS_TOPIC, ros2_messages.READINGS, ros2_messages.readings(layout.extra)))
    else:
        messages = [(TABLE_TOPIC, ros2_messages.TABLE_ROW, ros2_messages.table_row(layout.extra))]
    for signal, joints in layout.signals.items():
        topic, array = JOINT_TOPICS[signal]
        arrays = {array: signal}
        if signal == "q":
            arrays["velocity"] = "velocity"
            if layout.effort:
                arrays["effort"] = "torque"
        names = [layout.joints[joint - 1] for joint in joints]
        messages.append((topic, ros2_messages.JOINT_STATE, ros2_messages.joint_state(names, **arrays)))
    if layout.points:
        messages.append((POINT_TOPIC, ros2_messages.POINT_STAMPED, ros2_messages.point_stamped(layout.points, "xyz")))
    if layout.pose:
        messages.append((POSE_TOPIC, ros2_messages.POSE_STAMPED, ros2_messages.pose_stamped(POSE_FRAME, "base_pose")))
    return messages
