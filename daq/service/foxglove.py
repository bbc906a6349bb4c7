"""Rows on the screen: a WebSocket server for Foxglove and PlotJuggler, on loopback only.

The topics and messages are those of a recording (``daq.recording.messages.row_format``), so that one screen layout
serves live and recorded data alike.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from arm_clearance import Chain
from arm_clearance.viewing import viewer_urdf
from arm_io import DeviceFault
from daq.recording.messages import ros2_messages
from daq.recording.messages.cdr import Message, fillable, stamps
from daq.recording.messages.row_format import JOINT_TOPICS, POINT_TOPIC, POSE_FRAME, POSE_TOPIC
from daq.recording.messages.viewers import DESCRIPTION_TOPIC, TF_TOPIC, UNKNOWN_POSE, frame_names, frame_poses
from daq.service.row_block import Columns, poses_of

if TYPE_CHECKING:
    import foxglove

HOST = "127.0.0.1"
RATE = 200.0
"""Rows/s that are shown."""
DESCRIBED = 2.0
"""s between descriptions of the arm."""


class LiveView:
    """A server on ``port`` (0: any) that shows columns of rows of the named joints; ``port`` is then the one it has.

    chain  the arm, shown in 3D: /robot_description, and /tf of each shown row
    """

    def __init__(self, name: str, joints: Sequence[str], *, port: int = 8765, chain: Chain | None = None) -> None:
        import foxglove

        self._context = foxglove.Context()
        self._joints = list(joints)
        self._topics: dict[str, _Topic] = {}
        self._next_ns, self._base_pose = 0, UNKNOWN_POSE
        try:
            self._server = foxglove.start_server(name=name, host=HOST, port=port, context=self._context)
        except (OSError, RuntimeError) as error:
            raise DeviceFault("view", f"cannot listen on {HOST}:{port}: {error}; --port takes another") from None
        self.port = self._server.port
        self._frames = None if chain is None else _Frames(self._context, chain, self._joints)

    def show(self, columns: Columns) -> None:
        """Shows rows of a block, ``RATE`` a second of acquisition time; NaN is a gap."""
        wall_ns = columns["wall_ns"]
        if len(wall_ns) and int(wall_ns[0]) < self._next_ns - 1_000_000_000:
            self._next_ns, self._base_pose = 0, UNKNOWN_POSE  # time went back: another recording
        poses = poses_of(columns, self._base_pose)
        if len(poses):
            self._base_pose = poses[-1]
        for row in range(len(wall_ns)):
            if int(wall_ns[row]) < self._next_ns:
                continue
            self._next_ns = int(wall_ns[row]) + round(1e9 / RATE)
            for name in (*JOINT_TOPICS, "xyz", "points"):
                if name in columns:
                    self._topic(name).send(int(wall_ns[row]), columns[name][row])
            pose = poses[row] if len(poses) and np.isfinite(poses[row]).all() else None
            if pose is not None:
                self._topic("base_pose").send(int(wall_ns[row]), pose)
            if self._frames is not None and np.isfinite(columns["q"][row]).all():
                self._frames.send(int(wall_ns[row]), columns["q"][row], pose)

    def close(self) -> None:
        """Ends the server."""
        self._server.stop()

    def _topic(self, name: str) -> _Topic:
        if name not in self._topics:
            if name in JOINT_TOPICS:
                topic, array = JOINT_TOPICS[name]
                message = ros2_messages.joint_state(self._joints, **{array: name})
                kind = ros2_messages.JOINT_STATE
            elif name == "base_pose":
                topic, kind = POSE_TOPIC, ros2_messages.POSE_STAMPED
                message = ros2_messages.pose_stamped(POSE_FRAME, name)
            else:
                topic, kind = POINT_TOPIC, ros2_messages.POINT_STAMPED
                message = ros2_messages.point_stamped("tracker" if name == "points" else "base", name)
            self._topics[name] = _Topic(self._context, topic, kind, message, name)
        return self._topics[name]


class _Topic:
    def __init__(self, context: foxglove.Context, topic: str, kind: str, message: Message, field: str) -> None:
        self._channel = _channel(context, topic, kind)
        self._data, self._numbers = fillable(message)
        self._field = field

    def send(self, wall_ns: int, values: np.ndarray) -> None:
        self._numbers["stamp"] = stamps(np.array([wall_ns]))
        self._numbers[self._field] = values
        self._channel.log(bytes(self._data), log_time=wall_ns)


class _Frames:
    """The arm in 3D: its description, sent again every ``DESCRIBED`` s for who comes late, and where its links are."""

    def __init__(self, context: foxglove.Context, chain: Chain, joints: Sequence[str]) -> None:
        self._chain = chain
        self._tf = _channel(context, TF_TOPIC, ros2_messages.TF)
        self._description = _channel(context, DESCRIPTION_TOPIC, ros2_messages.STRING)
        self._urdf = ros2_messages.text(viewer_urdf(chain, joints))
        self._messages = {
            moving: fillable(ros2_messages.transforms(frame_names(chain, moving))) for moving in (False, True)
        }
        self._described = 0.0

    def send(self, wall_ns: int, q: np.ndarray, base: np.ndarray | None) -> None:
        """Transforms of the arm at q (n,), and of its floating base where its pose (7,) is known."""
        if time.monotonic() - self._described > DESCRIBED:
            self._described = time.monotonic()
            self._description.log(self._urdf, log_time=wall_ns)
        poses = frame_poses(self._chain, q[None], None if base is None else base[None])[0]
        data, numbers = self._messages[base is not None]
        stamp = stamps(np.array([wall_ns]))
        for number, pose in enumerate(poses, 1):
            numbers[f"stamp{number}"] = stamp
            numbers[f"pose{number}"] = pose
        self._tf.log(bytes(data), log_time=wall_ns)


def _channel(context: foxglove.Context, topic: str, kind: str) -> foxglove.Channel:
    import foxglove

    schema = foxglove.Schema(name=kind, encoding="ros2msg", data=ros2_messages.DEFINITIONS[kind].encode())
    return foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=context)
