"""What viewers need beside the rows: /tf at a low rate and /robot_description once, in chunks of their own.

Such a chunk begins with the channel of /tf, whose metadata says ``VIEWERS``. It holds nothing that the rows and the
model do not: a reader of ours passes over it, and a recording without it lacks nothing but its picture.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from arm_clearance import Chain
from arm_clearance.viewing import link_names, relative_poses, viewer_urdf
from daq.recording.messages import cdr, ros2_messages
from daq.recording.messages.row_format import POSE_FRAME, RECORD_HEAD, RowFormat

TF_TOPIC, DESCRIPTION_TOPIC = "/tf", "/robot_description"
VIEWERS = "viewers"
RATE = 50
"""Transforms per second: smooth to the eye."""
_LATCHED = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline: {sec: 9223372036, nsec: 854775807}\n"
    "  lifespan: {sec: 9223372036, nsec: 854775807}\n  liveliness: 1\n"
    "  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}\n  avoid_ros_namespace_conventions: false\n"
)
"""Quality of service of /robot_description: who comes late gets it too."""


def viewer_schemas(form: RowFormat) -> list[Schema]:
    """Schemas of the two topics, numbered behind those of the rows."""
    first = len(form.types) + 1
    return [
        Schema(first + k, ros2_messages.DEFINITIONS[name].encode(), "ros2msg", name)
        for k, name in enumerate((ros2_messages.TF, ros2_messages.STRING))
    ]


def viewer_channels(form: RowFormat) -> list[Channel]:
    """Channels of /tf and /robot_description, numbered behind those of the rows."""
    topics, types = len(form.topics), len(form.types)
    return [
        Channel(topics + 1, TF_TOPIC, "cdr", {"offered_qos_profiles": "", "armscope": VIEWERS}, types + 1),
        Channel(topics + 2, DESCRIPTION_TOPIC, "cdr", {"offered_qos_profiles": _LATCHED}, types + 2),
    ]


class Places(NamedTuple):
    """Messages of one channel in the content of a chunk: times ns (n,), and where their records begin (n,)."""

    channel: int
    wall_ns: NDArray[np.int64]
    starts: NDArray[np.uint64]


class ViewerMessage(NamedTuple):
    """A message in a chunk for viewers."""

    channel: int
    wall_ns: int
    start: int
    data: bytes


def messages_in(content: bytes) -> list[ViewerMessage]:
    """The messages of an intact chunk for viewers."""
    found, place = [], 0
    while place < len(content):
        opcode, length = struct.unpack_from("<BQ", content, place)
        if opcode == Opcode.MESSAGE:
            channel, _, wall_ns = struct.unpack_from("<HIQ", content, place + 9)
            data = content[place + RECORD_HEAD : place + 9 + length]
            found.append(ViewerMessage(channel, wall_ns, place, data))
        place += 9 + length
    return found


def places_in(content: bytes) -> Places:
    """Where the messages of a chunk for viewers are; they are all of one channel."""
    found = messages_in(content)
    times = np.array([one.wall_ns for one in found], np.int64)
    return Places(found[0].channel, times, np.array([one.start for one in found], np.uint64))


def frame_names(chain: Chain, moving: bool) -> list[str]:
    """Frames of /tf, each in the one before: of the links, and before them the world that a floating base moves in."""
    return [POSE_FRAME] * moving + link_names(chain)


def frame_poses(chain: Chain, q: NDArray[np.float64], pose: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(n, frames - 1, 7) of each frame in the one before: x y z m, quaternion x y z w; ``pose`` (n, 7) of the base."""
    shifts, turns = relative_poses(chain, q)
    poses = np.concatenate([shifts, turns], axis=2)
    return poses if pose is None else np.concatenate([pose[:, None], poses], axis=1)


def held(poses: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """``poses`` (n, 7) with each NaN replaced by the last known value of its column.

    ``before`` (7,): the last known values before the first row. The instruments that make up one pose have different
    rates.
    """
    known = np.concatenate([before[None], poses])
    newest = np.maximum.accumulate(np.where(np.isnan(known), 0, np.arange(len(known))[:, None]), axis=0)
    return np.asarray(np.take_along_axis(known, newest, axis=0)[1:])


UNKNOWN_POSE = np.full(7, np.nan)


class Viewers:
    """Chunks for viewers of an arm, made from rows as they are recorded.

    chain  the arm; joints: (n,) names
    """

    def __init__(self, form: RowFormat, chain: Chain, joints: Sequence[str]) -> None:
        self._chain, self._joints = chain, joints
        tf, description = viewer_channels(form)
        self._prologue = _record(tf)
        self._tf, self._description = tf.id, description.id
        self._message = ros2_messages.transforms(frame_names(chain, form.layout.pose))
        self._last = -1
        self._described = False

    def contents(
        self, q: NDArray[np.float64], wall_ns: NDArray[np.int64], pose: NDArray[np.float64] | None
    ) -> list[bytes]:
        """Contents of the chunks that belong to rows q (n, J) at ``wall_ns`` (n,): one or two, or none.

        ``pose`` (n, 7) of a floating base in the world: x y z m, quaternion x y z w.
        """
        ticks, known = wall_ns // (10**9 // RATE), np.isfinite(q).all(axis=1)
        if pose is not None:
            known &= np.isfinite(pose).all(axis=1)
        first = np.flatnonzero((np.diff(ticks, prepend=self._last) != 0) & known)
        if not len(first):
            return []
        self._last = int(ticks[first[-1]])
        poses = frame_poses(self._chain, q[first], None if pose is None else pose[first])
        made = [self._transforms(poses, wall_ns[first])]
        if not self._described:
            self._described = True
            data = ros2_messages.text(viewer_urdf(self._chain, self._joints))
            made.insert(0, self._prologue + _head(self._description, len(data), 0, int(wall_ns[first[0]])) + data)
        return made

    def _transforms(self, poses: NDArray[np.float64], wall_ns: NDArray[np.int64]) -> bytes:
        size, count = len(self._message.template), len(poses)
        names = list(self._message.fields)
        layout = np.dtype(
            {
                "names": ["head", *names],
                "formats": [f"V{RECORD_HEAD}", *(self._message.fields[name][0] for name in names)],
                "offsets": [0, *(RECORD_HEAD + self._message.fields[name][1] for name in names)],
                "itemsize": RECORD_HEAD + size,
            }
        )
        content = bytearray((bytes(RECORD_HEAD) + bytes(self._message.template)) * count)
        rows, stamps = np.frombuffer(content, layout), cdr.stamps(wall_ns)
        for number in range(poses.shape[1]):
            rows[f"stamp{number + 1}"] = stamps
            rows[f"pose{number + 1}"] = poses[:, number]
        for row, time in enumerate(wall_ns.tolist()):
            start = row * (RECORD_HEAD + size)
            content[start : start + RECORD_HEAD] = _head(self._tf, size, row, time)
        return self._prologue + bytes(content)


def _head(channel: int, size: int, sequence: int, wall_ns: int) -> bytes:
    return struct.pack("<BQHIQQ", Opcode.MESSAGE, 22 + size, channel, sequence, wall_ns, wall_ns)


def _record(channel: Channel) -> bytes:
    builder = RecordBuilder()
    channel.write(builder)
    return builder.end()
