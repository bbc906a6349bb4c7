"""Stretches of a long recording as recordings of their own, read by ranges of bytes and not as a whole.

The summary of a finished file says when each chunk of rows begins and where it lies (MCAP's chunk index), so that of a
file on an object store the head, the summary and the chunks of some stretches of time are asked for. Message indexes
are left out where a request costs less than they do.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, McapRecord, Statistics
from mcap.stream_reader import StreamReader

from arm_io import DeviceFault, InputError
from daq.acquisition.ledger import LedgerSummary, Loss
from daq.recording.contents import Contents
from daq.recording.mcap_file import walk as mcap_walk
from daq.recording.mcap_file.checksums import MAGIC
from daq.recording.mcap_file.checksums import NAME as CHECKSUMS
from daq.recording.messages.row_format import RowFormat, format_of, record_length
from daq.recording.parts import Files, finish_file, open_file, write_content

Read = Callable[[int, int], bytes]
"""Bytes ``start`` to ``end`` of a file."""
FOOTER = 29 + len(MAGIC)
"""Bytes: the footer's record and the magic behind it."""
NEAR = 1 << 16
"""Bytes that are read along rather than asked for in two requests."""
OWN = ("ledger.json", "recovery.json", CHECKSUMS)
"""Attachments that a stretch does not share with its recording."""


@dataclass(frozen=True)
class Ranges:
    """A finished recording from which ranges are read, with the content of its summary.

    name         of the file, for errors
    read         of its bytes
    form         of its rows
    chunks       of rows, in their order; first_ns, last_ns: times of its first and last row
    attachments  where they are
    """

    name: str
    read: Read
    form: RowFormat
    chunks: tuple[ChunkIndex, ...]
    attachments: tuple[AttachmentIndex, ...]
    first_ns: int
    last_ns: int

    @property
    def seconds(self) -> float:
        """s from the first row to the last."""
        return (self.last_ns - self.first_ns) * 1e-9

    @staticmethod
    def of(name: str, read: Read, size: int) -> Ranges | None:
        """Of a file of ``size`` bytes; None where it has no intact summary, or no rows of ours."""
        footer = read(max(0, size - FOOTER), size)
        if len(footer) < FOOTER or footer[:9] != struct.pack("<BQ", Opcode.FOOTER, 20) or footer[-8:] != MAGIC:
            return None
        (start,) = struct.unpack_from("<Q", footer, 9)
        summary = read(start, size) if len(MAGIC) < start < size - FOOTER else b""
        if not summary or zlib.crc32(summary[:-12]) != struct.unpack("<I", summary[-12:-8])[0]:
            return None
        try:
            return _ranges(name, read, list(StreamReader(BytesIO(summary), skip_magic=True).records))
        except (McapError, ValueError, struct.error):
            return None

    def write(self, spans: Sequence[tuple[float, float]], paths: Sequence[Path]) -> None:
        """Writes the rows of each span as a recording of its own, with the attachments and its part of the ledger.

        spans  s since the first row, from and to (exclusive); paths: of the recordings, one per span
        InputError where the rows of a span are damaged, or there are none; DeviceFault where the disk refuses.
        """
        contents = _head(self)
        ledger = contents.written_ledger()
        losses = () if ledger is None else ledger.losses
        files = {name: _typed(self, name, data) for name, data in contents.attachments.items() if name not in OWN}
        for (begin, end), path in zip(spans, paths, strict=True):
            pieces = list(_pieces(self, begin, end))
            if not pieces:
                raise InputError(self.name, f"has no rows from {begin:g} to {end:g} s")
            _write(path, self.form, files, pieces, losses)


def _ranges(name: str, read: Read, records: Sequence[McapRecord]) -> Ranges | None:
    rows_of = [one for one in records if isinstance(one, Channel) and "layout" in one.metadata]
    seen = next((one for one in records if isinstance(one, Statistics)), None)
    if not rows_of or seen is None:
        return None
    chunks = [one for one in records if isinstance(one, ChunkIndex) and rows_of[0].id in one.message_index_offsets]
    if not chunks:
        return None
    return Ranges(
        name=name,
        read=read,
        form=format_of(rows_of[0].metadata["layout"]),
        chunks=tuple(chunks),
        attachments=tuple(one for one in records if isinstance(one, AttachmentIndex)),
        first_ns=chunks[0].message_start_time,
        last_ns=chunks[-1].message_end_time,
    )


def _head(ranges: Ranges) -> Contents:
    """The attachments, wherever they are in the file."""
    first = ranges.chunks[0].chunk_start_offset
    data = ranges.read(0, first)
    for one in ranges.attachments:
        if one.offset >= first and one.name != CHECKSUMS:
            data += ranges.read(one.offset, one.offset + one.length)
    contents = Contents(memoryview(data), form=ranges.form)
    for part in mcap_walk.walk(contents.data):
        match part:
            case mcap_walk.File():
                contents.attachments[part.name] = part.data
            case mcap_walk.Damage():
                raise InputError(ranges.name, f"is damaged: {part.what}")
    return contents


def _typed(ranges: Ranges, name: str, data: bytes) -> tuple[str, bytes]:
    return next((one.media_type for one in ranges.attachments if one.name == name), "application/octet-stream"), data


Piece = tuple[bytes, np.ndarray]
"""Content of a chunk, and its rows."""


def _pieces(ranges: Ranges, begin: float, end: float) -> Iterator[Piece]:
    """The rows within a span, chunk by chunk."""
    low, high = (ranges.first_ns + round(1e9 * at) for at in (begin, end))
    form, size = ranges.form, len(ranges.form.template)
    for data in _read_merged(
        ranges.read, [one for one in ranges.chunks if one.message_end_time >= low and one.message_start_time < high]
    ):
        for part in mcap_walk.walk(memoryview(MAGIC + data)):
            if isinstance(part, mcap_walk.Damage):
                raise InputError(ranges.name, f"is damaged: {part.what}")
            if isinstance(part, mcap_walk.Rows):
                times = part.rows["times1"][:, 0].astype(np.int64)
                first, last = np.searchsorted(times, [low, high]).tolist()
                if first < last:
                    begins = record_length(part.content)
                    kept = part.content[begins + first * size : begins + last * size]
                    yield form.prologue + kept, part.rows[first:last]


def _read_merged(read: Read, chunks: Sequence[ChunkIndex]) -> Iterator[bytes]:
    """The bytes of chunks; chunks that are near each other are read in one request."""
    start = end = 0
    for one in chunks:
        first, last = one.chunk_start_offset, one.chunk_start_offset + one.chunk_length
        if end and first - end <= NEAR:
            end = last
            continue
        if end:
            yield read(start, end)
        start, end = first, last
    if end:
        yield read(start, end)


def _write(path: Path, form: RowFormat, files: Files, pieces: Sequence[Piece], losses: Sequence[Loss]) -> None:
    numbers = np.concatenate([rows["number"] for _, rows in pieces]).astype(np.int64)
    file = open_file(path, form, files, replace=True)
    try:
        for content, rows in pieces:
            write_content(file, form, content, rows["times1"][:, 0].astype(np.int64))
        finish_file(file, _ledger(numbers, losses))
    except OSError as error:
        file.abandon()
        raise DeviceFault("disk", f"{error.strerror} while writing {path}") from None
    except BaseException:
        file.abandon()
        raise


def _ledger(numbers: np.ndarray, losses: Sequence[Loss]) -> LedgerSummary:
    """Of the triggers from the first row of a stretch to its last."""
    first, last = int(numbers[0]), int(numbers[-1])
    inside = []
    for loss in losses:
        begin, end = max(loss.first, first), min(loss.first + loss.rows, last + 1)
        if begin < end:
            inside.append(Loss(begin, end - begin, loss.reason, loss.detail))
    triggers = len(numbers) + sum(loss.rows for loss in inside)
    return LedgerSummary(triggers, triggers, len(numbers), tuple(inside))
