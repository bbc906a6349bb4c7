"""Files as other people's programs write them: ROS 2 bags by rosbags, Parquet by pyarrow, .mat by scipy and h5py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from armscope.cli import run
from daq.recording import Recording, open_recording

START_NS = 1_700_000_000_123_456_789
NAMES = ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint")
RTDE = (
    "timestamp,target_q_0,target_q_1,actual_q_0,actual_q_1,actual_current_0,actual_current_1,actual_TCP_pose_0\n"
    + "".join(f"{100 + k * 0.002:.3f},{k},{-k},{k * 0.1},{k * 0.2},{k * 0.3},{k * 0.4},9\n" for k in range(30))
)
"""A log of Universal Robots' RTDE recorder."""


def imported(source: Path, *options: str) -> Recording:
    """The table as ``armscope import`` reads it."""
    out = source.parent / "imported.mcap"
    assert run(["import", str(source), "--out", str(out), *options]) == 0
    return open_recording(out)


def motion(rows: int = 500, joints: int = 3, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (n,) ns since 1970, q (n, J) rad, torque (n, J) N m."""
    rng = np.random.default_rng(seed)
    t = START_NS + np.cumsum(rng.integers(1_900_000, 2_100_000, rows))
    return t, rng.normal(size=(rows, joints)), rng.normal(size=(rows, joints))


def write_bag(
    path: Path,
    topics: dict[str, tuple[np.ndarray, dict[str, np.ndarray], tuple[str, ...]]],
    *,
    storage: str = "sqlite3",
    shifted_ns: int = 0,
    one_topic: str | None = None,
) -> None:
    """A bag of JointState: topic -> t ns, {position, effort: (n, J)}, names; messages come ``shifted_ns`` late.

    one_topic: on which all of them are published instead.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    state, header, time = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        names_of = {topic: one_topic or topic for topic in topics}
        connections = {
            name: writer.add_connection(name, state.__msgtype__, typestore=store)
            for name in dict.fromkeys(names_of.values())
        }
        channels = {topic: connections[name] for topic, name in names_of.items()}
        messages = [(int(t[row]), topic, row) for topic, (t, _, _) in topics.items() for row in range(len(t))]
        for stamp, topic, row in sorted(messages):
            _, arrays, names = topics[topic]
            parts = {
                array: np.asarray(arrays[array][row], float) if array in arrays else np.empty(0)
                for array in ("position", "velocity", "effort")
            }
            message = state(
                header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=""),
                name=list(names),
                **parts,
            )
            writer.write(channels[topic], stamp + shifted_ns, store.serialize_cdr(message, state.__msgtype__))


def write_franka_bag(path: Path, t: np.ndarray, q: np.ndarray, demanded: np.ndarray, effort: np.ndarray) -> None:
    """A bag of a type as franka_msgs/FrankaRobotState: header, joint states as fields, arrays besides; t (n,) ns."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    kind = "franka_msgs/msg/FrankaRobotState"
    text = (
        "std_msgs/Header header\nsensor_msgs/JointState measured_joint_state\n"
        "sensor_msgs/JointState desired_joint_state\nsensor_msgs/JointState tau_ext_hat_filtered\nfloat64[3] ddq_d\n"
        "uint8 ROBOT_MODE_MOVE=2\nuint8 robot_mode\n"
    )
    store.register(get_types_from_msg(text, kind))
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    joints, empty = store.types["sensor_msgs/msg/JointState"], np.empty(0)
    blank = header(stamp=time(sec=0, nanosec=0), frame_id="")

    def state(position: np.ndarray = empty, torque: np.ndarray = empty) -> Any:
        return joints(header=blank, name=list(NAMES), position=position, velocity=empty, effort=torque)

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        channel = writer.add_connection("/franka_robot_state_broadcaster/robot_state", kind, typestore=store)
        for row, stamp in enumerate(t.tolist()):
            message = store.types[kind](
                header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="base"),
                measured_joint_state=state(q[row], effort[row]),
                desired_joint_state=state(demanded[row], 0.0 * effort[row]),
                tau_ext_hat_filtered=state(torque=effort[row] / 9),
                ddq_d=np.zeros(3),
                robot_mode=2,
            )
            writer.write(channel, stamp + 5_000_000, store.serialize_cdr(message, kind))


def write_messages(path: Path, messages: list[tuple[int, int, dict[str, np.ndarray], tuple[str, ...]]]) -> None:
    """A bag of JointState on /joint_states, message by message: recorded ns, stamp ns, {position, effort}, names."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, time = (store.types[name] for name in kinds)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", kinds[0], typestore=store)
        for recorded, stamp, arrays, names in messages:
            filled = {name: arrays.get(name, np.empty(0)) for name in ("position", "velocity", "effort")}
            at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
            message = state(header=at, name=list(names), **filled)
            writer.write(connection, int(recorded), store.serialize_cdr(message, kinds[0]))


def write_controller_bag(
    path: Path, t: np.ndarray, q: np.ndarray, demanded: np.ndarray, *, every: int = 1, storage: str = "mcap"
) -> None:
    """Joint states with a gripper; every ``every``-th has the state of a trajectory controller beside it; t (n,) ns."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    kind = "control_msgs/msg/JointTrajectoryControllerState"
    point = "trajectory_msgs/JointTrajectoryPoint"
    fields = "".join(f"{point} {name}\n" for name in ("reference", "feedback", "error", "output"))
    store.register(get_types_from_msg(f"std_msgs/Header header\nstring[] joint_names\n{fields}", kind))
    names = ("JointState", "Header", "Time", "JointTrajectoryPoint", "Duration")
    of = {name: next(its for key, its in store.types.items() if key.endswith(f"/{name}")) for name in names}
    empty = np.empty(0)

    def at(positions: np.ndarray = empty) -> Any:
        nothing = of["Duration"](sec=0, nanosec=0)
        return of["JointTrajectoryPoint"](
            positions=positions, velocities=empty, accelerations=empty, effort=empty, time_from_start=nothing
        )

    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        controller = writer.add_connection("/arm_controller/controller_state", kind, typestore=store)
        for row, stamp in enumerate(t.tolist()):
            header = of["Header"](stamp=of["Time"](sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
            order = [*NAMES[::-1], "finger"]
            position = np.append(q[row, ::-1], 0.0)
            state = of["JointState"](header=header, name=order, position=position, velocity=empty, effort=position * 2)
            writer.write(states, stamp + 100, store.serialize_cdr(state, "sensor_msgs/msg/JointState"))
            if row % every == 0:
                points = [at(demanded[row]), at(q[row]), at(demanded[row] - q[row]), at()]
                message = store.types[kind](header, list(NAMES), *points)
                writer.write(controller, stamp + 200, store.serialize_cdr(message, kind))
