"""The ROS 2 messages of a recording: their definitions as MCAP schemas, and their bytes for given names and lengths."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from daq.recording.messages.cdr import Message

JOINT_STATE = "sensor_msgs/msg/JointState"
POINT_STAMPED = "geometry_msgs/msg/PointStamped"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
ROW = "armscope_msgs/msg/Row"
READINGS = "armscope_msgs/msg/Readings"
TABLE_ROW = "armscope_msgs/msg/TableRow"
TF = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"

_TIME = "int32 sec\nuint32 nanosec\n"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"


def _definition(text: str, **parts: str) -> str:
    """A message definition followed by those that it uses, as MCAP's 'ros2msg' requires them."""
    return text + "".join(f"{'=' * 80}\nMSG: {name.replace('__', '/')}\n{part}" for name, part in parts.items())


DEFINITIONS: dict[str, str] = {
    JOINT_STATE: _definition(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        std_msgs__Header=_HEADER,
        builtin_interfaces__Time=_TIME,
    ),
    POINT_STAMPED: _definition(
        "std_msgs/Header header\ngeometry_msgs/Point point\n",
        std_msgs__Header=_HEADER,
        geometry_msgs__Point="float64 x\nfloat64 y\nfloat64 z\n",
        builtin_interfaces__Time=_TIME,
    ),
    POSE_STAMPED: _definition(
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        std_msgs__Header=_HEADER,
        geometry_msgs__Pose="geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
        builtin_interfaces__Time=_TIME,
        geometry_msgs__Point="float64 x\nfloat64 y\nfloat64 z\n",
        geometry_msgs__Quaternion="float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ),
    TF: _definition(
        "geometry_msgs/TransformStamped[] transforms\n",
        geometry_msgs__TransformStamped="std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/Transform transform\n",
        std_msgs__Header=_HEADER,
        builtin_interfaces__Time=_TIME,
        geometry_msgs__Transform="geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
        geometry_msgs__Vector3="float64 x\nfloat64 y\nfloat64 z\n",
        geometry_msgs__Quaternion="float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ),
    STRING: "string data\n",
    ROW: _definition(
        "# One trigger: what the devices said, before calibration.\n"
        "builtin_interfaces/Time stamp  # wall time of the trigger\n"
        "int64 number                   # of the trigger since arming; a gap is a loss\n"
        "int64 host_ns                  # host's monotonic clock at the trigger\n"
        "int64 tick                     # clock device's own clock, 0: has none\n"
        "int64[] counts                 # counters, extended to 64 bit\n"
        "float64[] volts                # analogue inputs\n"
        "uint8[] quality                # counters, inputs, tracker; bits: 1 stale 2 saturated 4 quadrature error\n"
        "                               # 8 late 16 missing 32 device reset\n",
        builtin_interfaces__Time=_TIME,
    ),
    READINGS: _definition(
        "# Numbers of instruments on their own time; NaN in rows without a reading.\n"
        "builtin_interfaces/Time stamp  # wall time of the trigger\n"
        "string[] name\n"
        "float64[] value\n",
        builtin_interfaces__Time=_TIME,
    ),
    TABLE_ROW: _definition(
        "# One line of a table; its other columns are in the other topics.\n"
        "builtin_interfaces/Time stamp  # t rounded to ns\n"
        "int64 number                   # of the line, from 0\n"
        "float64 t                      # s, as in the table\n"
        "string[] name                  # further columns\n"
        "float64[] value\n",
        builtin_interfaces__Time=_TIME,
    ),
}
"""Type name -> definition (schema encoding 'ros2msg')."""


def joint_state(names: Sequence[str], *, position: str = "", velocity: str = "", effort: str = "") -> Message:
    """sensor_msgs/JointState whose three arrays are fields of the given names, and empty where that is ''."""
    message = Message().stamp("stamp").string("").strings(names)
    for field in (position, velocity, effort):
        message.sequence(field, "<f8", len(names) if field else 0)
    return message


def point_stamped(frame: str, field: str) -> Message:
    """geometry_msgs/PointStamped in frame ``frame``; ``field`` is (3,) x, y, z."""
    message = Message().stamp("stamp").string(frame)
    for axis in "xyz":
        message.number(axis, "<f8")
    offset = message.fields["x"][1]
    for axis in "xyz":
        del message.fields[axis]
    message.fields[field] = (("<f8", (3,)), offset)
    return message


def pose_stamped(frame: str, field: str) -> Message:
    """geometry_msgs/PoseStamped in frame ``frame``; ``field`` is (7,) x y z m, quaternion x y z w."""
    message = Message().stamp("stamp").string(frame).number(field, "<f8")
    message.fields[field] = (("<f8", (7,)), message.fields[field][1])
    message.template += bytes(48)
    return message


def transforms(frames: Sequence[str]) -> Message:
    """tf2_msgs/TFMessage: each frame in the one before it.

    Fields ``stamp1``, ``pose1`` (7,): x y z m, quaternion x y z w; and so on for all frames but the first.
    """
    message = Message().length(len(frames) - 1)
    for number, (parent, child) in enumerate(pairwise(frames), 1):
        message.stamp(f"stamp{number}").string(parent).string(child).number(f"pose{number}", "<f8")
        message.fields[f"pose{number}"] = (("<f8", (7,)), message.fields[f"pose{number}"][1])
        message.template += bytes(48)
    return message


def text(value: str) -> bytes:
    """std_msgs/String."""
    return bytes(Message().string(value).template)


def row(counters: int, inputs: int, quality: int) -> Message:
    """armscope_msgs/Row."""
    message = Message().stamp("stamp").number("number", "<i8").number("host_ns", "<i8").number("tick", "<i8")
    return (
        message.sequence("counts", "<i8", counters).sequence("volts", "<f8", inputs).sequence("quality", "u1", quality)
    )


def readings(names: Sequence[str]) -> Message:
    """armscope_msgs/Readings with the columns ``names``."""
    return Message().stamp("stamp").strings(names).sequence("extra", "<f8", len(names))


def table_row(extra: Sequence[str]) -> Message:
    """armscope_msgs/TableRow with the further columns ``extra``."""
    message = Message().stamp("stamp").number("number", "<i8").number("time", "<f8").strings(extra)
    return message.sequence("extra", "<f8", len(extra))
