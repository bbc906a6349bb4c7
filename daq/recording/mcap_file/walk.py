"""Walks the records of an MCAP file that may be unfinished or damaged, and hands out only what its checksums confirm.

A finished file, one cut off by a crash, and one with broken blocks take the same way: from record to record by their
lengths; where a record makes no sense, from the last confirmed one on to the next place that looks like one and is
confirmed. The summary is not needed. A chunk counts only if the checksum of its content is right, and its rows have our
layout.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Header, McapRecord, Metadata, Schema
from numpy.typing import NDArray

from arm_io.progress import report
from daq.recording.mcap_file.checksums import MAGIC
from daq.recording.mcap_file.pages import WINDOW, release
from daq.recording.messages.row_format import RowFormat, format_of
from daq.recording.messages.viewers import VIEWERS

LARGEST_CHUNK = 1 << 30
"""Content of a chunk, bytes; more is a broken length."""

REPORTED = 1 << 22
"""Bytes between two reports of how far a file is read."""

_LANDMARK = re.compile(
    rb"(?P<chunk>\x04\x00\x00\x00zstd)"
    rb"|(?P<attachment>[\x08-\x10]\x00\x00\x00[a-z]{3,12}\.(?:toml|json|crc32)[\x08-\x20]\x00\x00\x00appl)"
    rb"|(?P<metadata>\x11\x00\x00\x00armscope:progress)"
)
"""Where to pick up the thread: what stands at a fixed distance from the beginning of a record of ours."""
_DISTANCE = {"chunk": 37, "attachment": 25, "metadata": 9}
_LONGEST_LANDMARK = 64
"""Bytes: so far a landmark may reach beyond the window of the file in which it begins."""


@dataclass(frozen=True)
class Rows:
    """The rows of one intact chunk, and the bytes that they are views of."""

    form: RowFormat
    rows: NDArray[np.void]
    content: bytes


@dataclass(frozen=True)
class File:
    """An intact attachment."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True)
class Damage:
    """Bytes ``start`` to ``end`` of the file that could not be read, and why.

    ``end`` of the file: it is cut off there. ``rows``: nothing but a chunk of rows was there, and its indexes.
    """

    start: int
    end: int
    what: str
    rows: bool = False

    @property
    def sentence(self) -> str:
        """Which bytes of the file, and why."""
        return f"bytes {self.start} to {self.end} cannot be read: {self.what}"


@dataclass(frozen=True)
class End:
    """The rows end here, and the summary follows: the file was finished."""


@dataclass(frozen=True)
class Pictures:
    """The content of an intact chunk for viewers (``daq.recording.messages.viewers``)."""

    content: bytes


Part = Rows | Pictures | File | Metadata | Channel | Damage | End


R = TypeVar("R", bound=McapRecord)


class _BrokenRecord(ValueError):
    pass


def walk(data: memoryview) -> Iterator[Part]:
    """The parts of an MCAP file in their order.

    A stretch that cannot be read is one ``Damage``; the end of a file that was not finished is none, unless a record is
    cut in two there.
    """
    place, held, steps = len(MAGIC), 0, 0
    if data[:place] != MAGIC:
        yield Damage(0, place, "the file does not begin as an MCAP file does")
    while place < len(data):
        try:
            end, part = _record(data, place)
        except _BrokenRecord as error:
            end = _resume(data, place)
            part = Damage(place, end, str(error), rows=_is_chunk(data, place, end))
        if part is not None:
            yield part
        if isinstance(part, End):
            return
        place = end
        held = release(data, held, place)
        if place // REPORTED > steps:
            steps = place // REPORTED
            report("reading", place, len(data))


def _is_chunk(data: memoryview, place: int, end: int) -> bool:
    """Whether the damaged stretch is one chunk: any other record of ours behind it would have been resumed at."""
    if place + 9 > len(data):
        return False
    opcode, length = struct.unpack_from("<BQ", data, place)
    return bool(opcode == Opcode.CHUNK and place + 9 + length <= end < len(data))


def _resume(data: memoryview, place: int) -> int:
    """The next chunk, attachment or progress behind ``place`` that can be read, else the end of the file."""
    for first in range(place, len(data), WINDOW):
        for mark in _LANDMARK.finditer(data, first, min(first + WINDOW + _LONGEST_LANDMARK, len(data))):
            start = mark.start() - _DISTANCE[mark.lastgroup or ""]
            if start > place:
                try:
                    _record(data, start)
                except _BrokenRecord:
                    continue
                return start
        release(data, first, first + WINDOW)
    return len(data)


def _record(data: memoryview, place: int) -> tuple[int, Part | None]:
    """The record at ``place``: where it ends, and what is in it for us. Raises _BrokenRecord."""
    if place + 9 > len(data):
        raise _BrokenRecord("the file is cut off within a record")
    opcode, length = struct.unpack_from("<BQ", data, place)
    end = place + 9 + length
    if end > len(data):
        raise _BrokenRecord("the file is cut off within a record, or the record's length is wrong")
    body = data[place + 9 : end]
    try:
        return end, _end(data, end) if opcode == Opcode.DATA_END else _part(opcode, body)
    except _BrokenRecord:
        raise
    except (ValueError, LookupError, struct.error, zstandard.ZstdError, EndOfFile, MemoryError) as error:
        raise _BrokenRecord(f"a record cannot be decoded: {error}") from None


def _part(opcode: int, body: memoryview) -> Part | None:
    """What is in a record ahead of the summary. Every kind is checked for its length, so that no step leads astray."""
    match opcode:
        case Opcode.CHUNK:
            return _chunk(body)
        case Opcode.ATTACHMENT:
            return _attachment(body)
        case Opcode.METADATA:
            return _simple(Metadata, body)
        case Opcode.CHANNEL:
            return _simple(Channel, body)
        case Opcode.HEADER:
            _simple(Header, body)
        case Opcode.SCHEMA:
            _simple(Schema, body)
        case Opcode.MESSAGE_INDEX:
            if len(body) != 6 + struct.unpack_from("<I", body, 2)[0]:
                raise _BrokenRecord("a message index has a wrong length")
        case _:
            raise _BrokenRecord(f"a record of type {opcode} is not allowed here")
    return None


def _end(data: memoryview, summary: int) -> End:
    """Rows end as those of a finished file do only if the footer points back to their end and the summary is intact."""
    footer = struct.pack("<BQQ", Opcode.FOOTER, 20, summary)
    if data[-37:-20] != footer or data[-8:] != MAGIC:
        raise _BrokenRecord("the file is cut off in its summary, or the summary is damaged")
    if zlib.crc32(data[summary:-12]) != struct.unpack("<I", data[-12:-8])[0]:
        raise _BrokenRecord("the checksum of the summary is wrong")
    return End()


def _chunk(body: memoryview) -> Rows | Pictures:
    *_, checksum, name = struct.unpack_from("<QQQI8s", body)
    (length,) = struct.unpack_from("<Q", body, 36)
    if name != b"\x04\x00\x00\x00zstd" or length != len(body) - 44:
        raise _BrokenRecord("the head of a chunk is damaged")
    packed = body[44:]
    frame = zstandard.get_frame_parameters(packed)
    if not 0 <= frame.content_size <= LARGEST_CHUNK:
        raise _BrokenRecord("a chunk is damaged")
    content = zstandard.ZstdDecompressor().decompress(packed)
    # zstd has compared the frame's own checksum (32 bits of XXH64), in a third of the time that CRC-32 takes.
    if not frame.has_checksum and zlib.crc32(content) != checksum:
        raise _BrokenRecord("the checksum of a chunk is wrong")
    opcode, length = struct.unpack_from("<BQ", content)
    if opcode != Opcode.CHANNEL:
        raise _BrokenRecord("a chunk was not written by armscope")
    metadata = _simple(Channel, memoryview(content)[9 : 9 + length]).metadata
    if metadata.get("armscope") == VIEWERS:
        return Pictures(content)
    form = format_of(metadata["layout"])
    return Rows(form, form.unpack(content), content)


def _attachment(body: memoryview) -> File:
    if zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
        raise _BrokenRecord("the checksum of an attachment is wrong")
    texts, place = [], 16
    for _ in range(2):
        (length,) = struct.unpack_from("<I", body, place)
        texts.append(str(body[place + 4 : place + 4 + length], "utf-8"))
        place += 4 + length
    return File(texts[0], texts[1], bytes(body[place + 8 : -4]))


def _simple(kind: type[R], body: memoryview) -> R:
    stream = ReadDataStream(BytesIO(body))
    record: R = kind.read(stream)  # type: ignore[attr-defined]
    if stream.count != len(body):
        raise _BrokenRecord("a record has a wrong length")
    return record
