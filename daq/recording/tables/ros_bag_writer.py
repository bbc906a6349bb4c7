"""A recording as a ROS 2 bag, a folder with metadata.yaml: in sqlite3, which every ROS 2 reads, or in MCAP."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from arm_io import InputError, whole_path
from arm_io.optional import optional
from daq.recording.blocks import LongRecording, Message


def write_bag(path: str | Path, recording: LongRecording, storage: Literal["sqlite3", "mcap"] = "sqlite3") -> list[str]:
    """Writes the messages of a recording, whole or not at all; returns the topics.

    The bytes of each message are those of the recording. The types of armscope_msgs, which a ROS installation does not
    have, are left out. InputError where rosbags is not installed, the folder is there, or it cannot be written.
    """
    bags, types = optional("rosbags.rosbag2", "ros", path), optional("rosbags.typesys", "ros", path)
    plugin = bags.StoragePlugin.MCAP if storage == "mcap" else bags.StoragePlugin.SQLITE3
    store = types.get_typestore(types.Stores.LATEST)
    try:
        with whole_path(path, folder=True) as place, bags.Writer(place, version=9, storage_plugin=plugin) as writer:
            return _copy(writer, store, recording.messages())
    except sqlite3.Error as error:
        raise InputError(path, f"cannot be written: {error}") from None


def _copy(writer: Any, store: Any, messages: Iterable[Message]) -> list[str]:
    connections: dict[str, Any] = {}
    for message in messages:
        if message.type.startswith("armscope_msgs/"):
            continue
        if message.topic not in connections:
            connections[message.topic] = writer.add_connection(message.topic, message.type, typestore=store)
        writer.write(connections[message.topic], message.wall_ns, message.data)
    return list(connections)
