"""Joint states and points in the messages of ROS 2 bags: on topics of their own, or as fields of a robot's message."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from daq.recording.messages.ros2_messages import JOINT_STATE

POINT = "geometry_msgs/msg/PointStamped"
ARRAYS = ("position", "velocity", "effort")


def fields_of(definitions: dict[str, Any], message_type: str) -> tuple[str, ...]:
    """Fields of a message type that are joint states; ("",) where the type is one itself, or a point.

    franka_msgs/FrankaRobotState has measured_joint_state and desired_joint_state, for example. definitions: of a
    typestore of rosbags, by type; a type that neither the bag nor rosbags defines has none.
    """
    if message_type in (JOINT_STATE, POINT):
        return ("",)
    _, fields = definitions.get(message_type, ((), ()))
    return tuple(name for name, (_, described) in fields if described == JOINT_STATE)


def parts(topic: str, message: Any, fields: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Name and joint state or point: the topic itself, or TOPIC/FIELD per field."""
    for field in fields:
        yield (f"{topic}/{field}", getattr(message, field)) if field else (topic, message)


def stamp_of(message: Any) -> int:
    """ns since 1970, 0 where the message has no stamp."""
    header = getattr(message, "header", None)
    return 0 if header is None else int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def columns_of(name: str, part: Any) -> dict[str, float]:
    """Name of a column -> number in a joint state or point: NAME.position.JOINT, NAME.x."""
    if hasattr(part, "point"):
        return {f"{name}.{axis}": getattr(part.point, axis) for axis in "xyz"}
    return {
        f"{name}.{array}.{joint}": value
        for array in ARRAYS
        for joint, value in zip(part.name, getattr(part, array).tolist())
    }
