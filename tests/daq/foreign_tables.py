"""Files as other people's programs write them: ROS 2 bags by rosbags, Parquet by pyarrow, .mat by scipy and h5py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

START_NS = 1_700_000_000_123_456_789
NAMES = ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint")


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
) -> None:
    """A bag of JointState: topic -> t ns, {position, effort: (n, J)}, names; messages come ``shifted_ns`` late."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    state, header, time = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        channels = {topic: writer.add_connection(topic, state.__msgtype__, typestore=store) for topic in topics}
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
