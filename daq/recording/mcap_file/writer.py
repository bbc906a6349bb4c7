"""An MCAP file in the making: head, chunks, attachments, summary (https://mcap.dev/spec).

The file is called ``RUN.mcap.active`` until it is whole. What the operating system refuses is undone: after an OSError
the file ends where it ended before, and what was written earlier stays readable. One number in the head, the progress,
is overwritten in place, so that after a crash the file itself holds the number of rows passed to the recorder.
"""

from __future__ import annotations

import json
import os
import struct
import time
import zlib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from arm_io import DeviceFault, InputError, check_file
from arm_io.files import open_regular
from arm_io.handles import PLAIN, folder_to_disk, to_disk, try_lock, write_at
from daq.recording.mcap_file import checksums
from daq.recording.mcap_file.checksums import MAGIC, Checksums
from daq.recording.mcap_file.pages import ACTIVE

PROGRESS = "armscope:progress"
LEVEL = -1
"""Of zstd: writes as small as level 1 what rows are made of, and is read a third faster.

Level 3 saves a sixth for half the speed.
"""


@dataclass(frozen=True)
class Progress:
    """Rows handed to the recorder: how many, trigger numbers of the first and last, wall time of the last (ns)."""

    rows: int = 0
    first: int = 0
    last: int = -1
    wall_ns: int = 0

    def to_metadata(self) -> Metadata:
        """As the file keeps it: numbers of fixed width, and their checksum."""
        values = [f"{value:020d}" for value in (self.rows, self.first, self.last, self.wall_ns)]
        check = f"{zlib.crc32(' '.join(values).encode()):08x}"
        return Metadata(PROGRESS, dict(zip(("rows", "first", "last", "wall_ns", "crc"), [*values, check])))

    @staticmethod
    def from_metadata(values: dict[str, str]) -> Progress | None:
        """None where the numbers do not match their checksum."""
        try:
            progress = Progress(*(int(values[key]) for key in ("rows", "first", "last", "wall_ns")))
        except (KeyError, ValueError):
            return None
        return progress if progress.to_metadata().metadata == values else None


@dataclass
class McapFile:
    """A file being written. Every method raises OSError where the disk refuses, and leaves the file as it was before.

    path  where the finished file will be; until then it is ``active``
    """

    path: Path
    active: Path
    _handle: int
    _end: int = 0
    _progress_offset: int = 0
    _progress_entry: int = 0
    _schemas: list[Schema] = field(default_factory=list)
    _channels: list[Channel] = field(default_factory=list)
    _chunks: bytearray = field(default_factory=bytearray)
    _chunk_count: int = 0
    _times: tuple[int, int] = (0, 0)
    _checksums: Checksums = field(default_factory=Checksums)
    _progress: bytes = b""
    _attachments: list[AttachmentIndex] = field(default_factory=list)
    _metadata: list[MetadataIndex] = field(default_factory=list)
    _counts: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    _compressor: zstandard.ZstdCompressor = field(
        default_factory=lambda: zstandard.ZstdCompressor(level=LEVEL, write_checksum=True)
    )

    def begin(self, library: str, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        """The head: profile ros2, schemas and channels, ahead of everything else, and the progress."""
        self._schemas, self._channels = list(schemas), list(channels)
        records = [Header("ros2", library), *self._schemas, *self._channels]
        self._write([MAGIC, *(_bytes(record) for record in records)])
        self._progress_offset, self._progress_entry = self._end, len(self._checksums)
        self.metadata(Progress().to_metadata())

    def progress(self, progress: Progress) -> None:
        """Overwrites the progress in place."""
        record = _bytes(progress.to_metadata())
        write_at(self._handle, record, self._progress_offset)
        self._progress = record

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """An attachment, with a checksum of its own."""
        now = time.time_ns()
        offset = self._write([_bytes(Attachment(now, now, name, media_type, data))])
        self._attachments.append(AttachmentIndex(offset, self._end - offset, now, now, len(data), name, media_type))

    def metadata(self, record: Metadata) -> None:
        """Text that other tools show without knowing us."""
        offset = self._write([_bytes(record)])
        self._metadata.append(MetadataIndex(offset, self._end - offset, record.name))

    def chunk(
        self, content: bytes | bytearray, wall_ns: NDArray[np.int64], offsets: dict[int, NDArray[np.uint64]]
    ) -> None:
        """A compressed chunk of message records, and its message indexes.

        content  the records; wall_ns: (n,) times of the rows; offsets: channel -> (n,) where its messages begin in
                 ``content``
        """
        first, last = int(wall_ns.min()), int(wall_ns.max())
        data = self._compressor.compress(content)
        body = struct.pack("<QQQI", first, last, len(content), zlib.crc32(content))
        body += struct.pack("<I4sQ", 4, b"zstd", len(data))
        length = len(body) + len(data)
        records, places, size = [b"".join([struct.pack("<BQ", Opcode.CHUNK, length), body, data])], {}, 9 + length
        for channel, starts in offsets.items():
            entries = np.column_stack([wall_ns.astype(np.uint64), starts]).tobytes()
            places[channel] = self._end + size
            records.append(
                struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries
            )
            size += len(records[-1])
        offset = self._write(records)
        for channel, starts in offsets.items():
            self._counts[channel] += len(starts)
        self._times = (min(self._times[0], first), max(self._times[1], last)) if self._chunks else (first, last)
        self._chunk_count += 1
        # As bytes: a recording of a day has half a million of them.
        self._chunks += _bytes(
            ChunkIndex(
                chunk_length=9 + length,
                chunk_start_offset=offset,
                compression="zstd",
                compressed_size=len(data),
                message_end_time=last,
                message_index_length=size - 9 - length,
                message_index_offsets=places,
                message_start_time=first,
                uncompressed_size=len(content),
            )
        )

    def sync(self) -> None:
        """Waits until everything written is on the disk."""
        to_disk(self._handle)

    def finish(self) -> None:
        """Writes checksums, summary and footer, then gives the file its name.

        After an OSError the file keeps the name ``active`` and all its rows.
        """
        if self._progress:
            self._checksums.change(self._progress_entry, self._progress)
        self.attach(checksums.NAME, checksums.MEDIA_TYPE, self._checksums.to_bytes())
        self._write([_bytes(DataEnd(self._checksums.of_all())), self._summary(self._end + 13)])
        self.sync()
        self.close()
        os.replace(self.active, self.path)
        folder_to_disk(self.path.parent)

    def close(self) -> None:
        """Closes the file as it is, unfinished if ``finish`` was not called. May be called again."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def abandon(self) -> None:
        """Removes the unfinished file."""
        self.close()
        self.active.unlink(missing_ok=True)

    def _write(self, records: list[bytes]) -> int:
        """Appends all records or none, with a checksum of each; returns where they begin."""
        data = b"".join(records)
        start, rest = self._end, memoryview(data)
        try:
            while rest:
                rest = rest[write_at(self._handle, rest, self._end + len(data) - len(rest)) :]
        except OSError:
            os.ftruncate(self._handle, self._end)
            raise
        self._end += len(data)
        for record in records:
            self._checksums.add(record)
        return start

    def _summary(self, start: int) -> bytes:
        groups = [
            _bytes(*self._schemas),
            _bytes(*self._channels),
            _bytes(self._statistics()),
            bytes(self._chunks),
            _bytes(*self._attachments),
            _bytes(*self._metadata),
        ]
        summary, offsets = bytearray(), bytearray()
        for data in groups:
            if data:
                offsets += _bytes(SummaryOffset(data[0], start + len(summary), len(data)))
                summary += data
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, start + len(summary))
        checksum = zlib.crc32(summary + offsets + footer)
        return bytes(summary + offsets) + _bytes(Footer(start, start + len(summary), checksum)) + MAGIC

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            message_end_time=self._times[1],
            message_start_time=self._times[0],
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def create(path: str | Path, *, live: bool = False, replace: bool = False) -> McapFile:
    """Opens ``path`` for writing under another name.

    InputError where it exists (unless ``replace``), or cannot be made; DeviceFault where the host's clock is before
    1970.

    live  True: the other name is ``path.active``, because what is in it is found nowhere else; never replaces one. A
          lock on it marks that a process still writes it (``being_written``). False: ``path.part``
    """
    check_file(path)
    _check_clock()
    path = Path(path)
    active = path.with_name(path.name + (ACTIVE if live else ".part"))
    if path.exists() and not replace:
        raise InputError(path, "exists already, and no recording is overwritten; use another name")
    handle = -1
    try:
        handle = os.open(active, os.O_RDWR | os.O_CREAT | PLAIN | (os.O_EXCL if live else 0), 0o644)
        if not try_lock(handle):
            os.close(handle)
            raise InputError(path, "is being written by another process")
        os.ftruncate(handle, 0)
    except FileExistsError:
        raise InputError(
            active, "an unfinished recording is there; 'armscope recover' it first, or remove it"
        ) from None
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
    return McapFile(path, active, handle)


def _check_clock() -> None:
    """DeviceFault if the host's clock shows a time that a file cannot hold.

    MCAP counts nanoseconds from 1970 on; ROS has 31 bits for the seconds.
    """
    now = time.time_ns()
    if not 0 <= now < 2**31 * 10**9:
        raise DeviceFault("clock", f"the host's clock is {now / 1e9:.0f} s after 1970, beyond 1970 to 2038; set it")


def being_written(path: str | Path) -> bool:
    """True while a process has the file ``path`` open for recording."""
    with os.fdopen(open_regular(path), "rb") as file:
        return not try_lock(file.fileno(), shared=True)


def as_json(value: object) -> bytes:
    """A JSON text for an attachment."""
    return json.dumps(value, indent=1).encode()


def _bytes(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
