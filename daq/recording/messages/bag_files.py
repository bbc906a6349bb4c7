"""The files of a ROS 2 bag, also of one whose recorder was interrupted: without metadata, or with a file cut off."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from arm_io import InputError
from arm_io.files import open_regular

MAGIC = b"\x89MCAP0\r\n"
"""Begins and ends an MCAP file."""
_PART = re.compile(r"(.+)_(\d+)(\.mcap|\.db3)")
"""The name of a part of a bag as rosbag2 writes it: NAME_0.mcap, NAME_1.mcap, .."""


def parts_of(folder: Path) -> list[Path]:
    """The parts of a bag in a folder without metadata.yaml, in order; [] where its files are no parts of one bag."""
    found = [(match, folder / name) for name in os.listdir(folder) if (match := _PART.fullmatch(name))]
    others = [name for name in os.listdir(folder) if name.endswith((".mcap", ".db3")) and not _PART.fullmatch(name)]
    if others or len({(match[1], match[3]) for match, _ in found}) != 1:
        return []
    return [path for _, path in sorted(found, key=lambda one: int(one[0][2]))]


class BagFiles:
    """What a reader of bags must open for a path: the bag itself, or its files, of which some are completed copies.

    paths  the folder of a whole bag, or files; copies of files that were cut off are deleted with this object
    notes  which files were read without metadata, and which are cut off
    cut    whether a file is cut off: an MCAP file without its end, as it stays when its recorder was killed
    InputError where a file that is cut off holds no message.
    """

    def __init__(self, path: Path) -> None:
        self.notes: list[str] = []
        self._copies: TemporaryDirectory[str] | None = None
        whole = os.path.isfile(path / "metadata.yaml")
        files = sorted(path.glob("*.mcap")) if whole else parts_of(path) if os.path.isdir(path) else [path]
        cut = {file for file in files if file.suffix == ".mcap" and not _is_closed(file)}
        self.cut = bool(cut)
        if whole and not cut:
            self.paths = [path]
            return
        if os.path.isdir(path) and not whole:
            self.notes.append(f"has no metadata.yaml; read were {', '.join(file.name for file in files)}")
        opened = [self._completed(file) if file in cut else file for file in files]
        self.paths = [file for file in opened if file is not None]
        if not self.paths:
            raise InputError(path, "was cut off before its first message was written: it holds none")

    def _completed(self, file: Path) -> Path | None:
        """A copy with every message up to where the file ends, closed as MCAP requires; None where there is none."""
        from mcap.writer import Writer

        if self._copies is None:
            self._copies = TemporaryDirectory(prefix="armscope-bag-")
        copy = Path(self._copies.name, file.name)
        count = 0
        with os.fdopen(open_regular(file), "rb") as source, copy.open("wb") as target:
            writer = Writer(target)
            writer.start("ros2")
            schemas, channels = dict[int, int](), dict[int, int]()
            for record in _records(source):
                match type(record).__name__:
                    case "Schema":
                        if record.id not in schemas:
                            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                    case "Channel":
                        if record.id not in channels:
                            channels[record.id] = writer.register_channel(
                                record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
                            )
                    case "Message":
                        channel = channels[record.channel_id]
                        writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                        count += 1
            writer.finish()
        self.notes.append(f"{file.name} is cut off (its recorder did not close it): its {count} messages were read")
        return copy if count else None


def _is_closed(file: Path) -> bool:
    """Whether an MCAP file ends as one that was closed does; a file that begins as no MCAP file counts as closed."""
    with os.fdopen(open_regular(file), "rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return os.fstat(stream.fileno()).st_size > 0
        stream.seek(-len(MAGIC), os.SEEK_END)
        return stream.tell() > 0 and stream.read() == MAGIC


def _records(source: Any) -> Iterator[Any]:
    """The records of an MCAP file, up to the last whole one."""
    from mcap.exceptions import EndOfFile, InvalidMagic
    from mcap.stream_reader import StreamReader

    try:
        yield from StreamReader(source).records
    except (EndOfFile, InvalidMagic, struct.error):  # the last record ends within itself, or within a number
        return
