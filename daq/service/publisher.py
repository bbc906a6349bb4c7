"""Puts rows on Zenoh: every row in blocks, the newest one as a ROS message, and what the server is doing.

Data is dropped, never waited for: a wedged subscriber must not hold up the sampler (put under a full queue costs a few
microseconds). Every block says what came before it, so that whoever misses something knows how much
(``daq.service.row_block``). A replay has nothing to hold up and waits instead (``reliable``).
"""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.recording.messages import ros2_messages
from daq.recording.messages.cdr import fillable, stamps
from daq.recording.messages.rates import rates
from daq.recording.messages.row_format import POSE_FRAME
from daq.recording.messages.viewers import UNKNOWN_POSE
from daq.service.row_block import MEDIA_TYPE, Columns, describe, encode, poses_of
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh

    from daq.service.ros2_keys import RosPublisher

JOINT_STATE_SECONDS = 0.01
"""Shortest time between two JointStates."""


class Publisher:
    """The rows of one rig, run after run.

    joints    (J,) names
    reliable  True: wait for slow subscribers (replay); False: drop what they cannot take
    ros       the same JointState once more, under ROS 2's key; None: not
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        joints: Sequence[str],
        *,
        reliable: bool = False,
        ros: RosPublisher | None = None,
    ) -> None:
        import zenoh

        congestion = zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP
        self._rows = session.declare_publisher(keys.rows, encoding=MEDIA_TYPE, congestion_control=congestion)
        self._joint_states = session.declare_publisher(
            keys.joint_states,
            encoding=f"application/cdr;{ros2_messages.JOINT_STATE}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
        )
        self._poses = session.declare_publisher(
            keys.base_pose,
            encoding=f"application/cdr;{ros2_messages.POSE_STAMPED}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
        )
        self._state = session.declare_publisher(
            keys.state,
            encoding="application/json",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )
        self._joints = tuple(joints)
        self._ros = ros
        self._joint_state = _JointState(self._joints)
        self._pose = fillable(ros2_messages.pose_stamped(POSE_FRAME, "pose"))
        self.begin()

    def begin(self) -> str:
        """Starts a new run, with blocks and rows numbered from 0; returns its id."""
        self._run = uuid.uuid4()
        self._sequence = self._before = 0
        self._description = b""
        self._columns: Columns = {}
        self._next_joint_state = 0.0
        self._joint_state.forget()
        self._base_pose = UNKNOWN_POSE
        return self._run.hex

    @property
    def rows(self) -> int:
        """Rows published in this run."""
        return self._before

    @property
    def blocks(self) -> int:
        """Blocks published in this run."""
        return self._sequence

    @property
    def watched(self) -> bool:
        """Whether anybody has subscribed to the rows."""
        return bool(self._rows.matching_status.matching)  # type: ignore[attr-defined]  # its stub says bool

    def publish(self, columns: Columns) -> None:
        """One block: columns of equally many rows, the same columns through a run; nothing happens without rows."""
        rows = len(columns["wall_ns"])
        if not rows:
            return
        if not self._description:
            self._description = describe(columns, self._joints)
            self._columns = {name: values[:0] for name, values in columns.items()}
        self._put(columns, rows, last=False)
        poses = poses_of(columns, self._base_pose)
        if len(poses):
            self._base_pose = poses[-1]
        now = time.monotonic()
        if now >= self._next_joint_state and "q" in columns:
            self._next_joint_state = now + JOINT_STATE_SECONDS
            message = self._joint_state(columns["q"][-1], int(columns["wall_ns"][-1]))
            self._joint_states.put(message)
            if self._ros is not None:
                self._ros.put(message)
            if np.isfinite(self._base_pose).all():
                data, fields = self._pose
                fields["stamp"], fields["pose"] = stamps(columns["wall_ns"][-1:]), self._base_pose
                self._poses.put(bytes(data))

    def finish(self) -> None:
        """Ends the run: an empty last block gives subscribers the number of rows."""
        if self._description:
            self._put(self._columns, 0, last=True)

    def state(self, table: dict[str, Any]) -> None:
        """What the server is doing."""
        self._state.put(json.dumps(table))

    def _put(self, columns: Columns, rows: int, *, last: bool) -> None:
        self._rows.put(encode(columns, self._description, self._run, self._sequence, self._before, last=last))
        self._sequence += 1
        self._before += rows


class _JointState:
    """sensor_msgs/JointState of one row: position, and velocity by the two messages before (``rates``)."""

    def __init__(self, joints: Sequence[str]) -> None:
        self._buffer, self._fields = fillable(
            ros2_messages.joint_state(joints, position="position", velocity="velocity")
        )
        self.forget()

    def forget(self) -> None:
        """The next message is the first of a run: its velocity is unknown (NaN)."""
        self._positions: list[NDArray[np.float64]] = []
        self._wall_ns: list[int] = []

    def __call__(self, position: NDArray[np.float64], wall_ns: int) -> bytes:
        self._positions = [*self._positions[-2:], position.copy()]
        self._wall_ns = [*self._wall_ns[-2:], wall_ns]
        self._fields["stamp"] = stamps(np.array([wall_ns]))
        self._fields["position"] = position
        self._fields["velocity"] = rates(np.array(self._positions), np.array(self._wall_ns))[-1]
        return bytes(self._buffer)
