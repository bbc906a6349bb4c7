"""Joint states and points in the messages of ROS 2 bags: on topics of their own, or as fields of a robot's message."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from arm_io.types import Array
from daq.recording.messages.ros2_messages import JOINT_STATE

POINT = "geometry_msgs/msg/PointStamped"
ARRAYS = ("position", "velocity", "effort")
TRAJECTORY_POINT = "trajectory_msgs/msg/JointTrajectoryPoint"
DEMANDS = ("reference", "desired")
"""Fields of control_msgs/JointTrajectoryControllerState with the demand of its joint_names, newer name first."""


@dataclass(frozen=True)
class Demand:
    """The demanded positions of some joints, from the state of a trajectory controller."""

    name: list[str]
    position: Array


def fields_of(definitions: dict[str, Any], message_type: str) -> tuple[str, ...]:
    """Fields of a message type that are joint states or demands; ("",) where the type is a joint state, or a point.

    franka_msgs/FrankaRobotState has measured_joint_state and desired_joint_state, for example, and
    control_msgs/JointTrajectoryControllerState has reference. definitions: of a typestore of rosbags, by type; a type
    that neither the bag nor rosbags defines has none.
    """
    if message_type in (JOINT_STATE, POINT):
        return ("",)
    _, fields = definitions.get(message_type, ((), ()))
    if "joint_names" in (name for name, _ in fields):
        points = [name for name, (_, described) in fields if described == TRAJECTORY_POINT and name in DEMANDS]
        return tuple(sorted(points, key=DEMANDS.index)[:1])
    return tuple(name for name, (_, described) in fields if described == JOINT_STATE)


def demands_without_definition(reader: Any, connection: Any) -> bool:
    """Whether a connection has the states of a trajectory controller, which neither the bag nor rosbags defines."""
    kind = str(connection.msgtype)
    return kind.endswith("/JointTrajectoryControllerState") and kind not in reader.typestore.fielddefs


def parts(topic: str, message: Any, fields: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Name and joint state, point or demand: the topic itself, or TOPIC/FIELD per field."""
    for field in fields:
        part = getattr(message, field) if field else message
        if field in DEMANDS:
            part = Demand(list(message.joint_names), part.positions)
        yield f"{topic}/{field}" if field else topic, part


def stamp_of(message: Any) -> int:
    """ns since 1970, 0 where the message has no stamp."""
    header = getattr(message, "header", None)
    return 0 if header is None else int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def columns_of(name: str, part: Any) -> dict[str, float]:
    """Name of a column -> number in a joint state, demand or point: NAME.position.JOINT, NAME.x."""
    if hasattr(part, "point"):
        return {f"{name}.{axis}": getattr(part.point, axis) for axis in "xyz"}
    return {
        f"{name}.{array}.{joint}": value
        for array in ARRAYS
        if hasattr(part, array)
        for joint, value in zip(part.name, getattr(part, array).tolist())
    }
