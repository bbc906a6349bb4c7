"""Checksums of every record of a file, inside the file.

An attachment lists them; MCAP's own checksums of the data section and of the summary are written as well.

The last attachment is called ``checksums.crc32``. It has an entry of 13 bytes for each record before it, in their
order, the first for the eight bytes of magic: opcode (uint8; 0: the magic), length of the whole record (uint64), CRC-32
of the whole record (uint32), little endian. The attachment's own checksum guards the list; the DataEnd record carries
the CRC-32 of all before it, as MCAP has it (so other tools check it too), and the footer that of the summary. Not one
bit of a finished file is left out.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from mcap.opcode import Opcode

from arm_io.progress import report
from daq.recording.mcap_file.crc32 import crc32_of_parts
from daq.recording.mcap_file.pages import WINDOW, release

MAGIC = b"\x89MCAP0\r\n"
NAME = "checksums.crc32"
MEDIA_TYPE = "application/octet-stream"
ENTRY = np.dtype([("opcode", "u1"), ("length", "<u8"), ("crc", "<u4")])

_NAME_OFFSET = 29
"""Where the name stands in the record of an attachment: behind opcode, length, two times, and its own length."""
_DATA_END = struct.Struct("<BQI")
_FOOTER = struct.Struct("<BQQQI")


class Integrity(StrEnum):
    """What the checksums of a file say; each with a sentence in ``SENTENCES``."""

    VERIFIED = "verified"
    DAMAGED = "damaged"
    UNFINISHED = "unfinished"
    NO_CHECKSUMS = "no_checksums"


SENTENCES = {
    Integrity.VERIFIED: "every record agrees with its checksum",
    Integrity.DAMAGED: "the file has changed since it was written",
    Integrity.UNFINISHED: "no checksums of all records: the file was not finished",
    Integrity.NO_CHECKSUMS: "no checksums: written by an older armscope",
}


@dataclass(frozen=True)
class DamagedRecord:
    """Bytes ``start`` to ``end`` of the file are not as they were written; ``opcode`` of the record (0: no record)."""

    name: str
    opcode: int
    start: int
    end: int

    @property
    def sentence(self) -> str:
        """Which record, and which bytes of the file."""
        return f"{self.name} is damaged: bytes {self.start} to {self.end} do not agree with their checksum"


@dataclass(frozen=True)
class Verification:
    """``records`` that were held against a checksum, and those that do not agree."""

    integrity: Integrity
    records: int
    damages: tuple[DamagedRecord, ...] = ()


class Checksums:
    """The list in the making."""

    def __init__(self) -> None:
        self._entries = bytearray()

    def __len__(self) -> int:
        return len(self._entries) // ENTRY.itemsize

    def add(self, record: bytes) -> None:
        """The next record, or the magic."""
        opcode = 0 if record == MAGIC else record[0]
        self._entries += struct.pack("<BQI", opcode, len(record), zlib.crc32(record))

    def change(self, place: int, record: bytes) -> None:
        """Record number ``place`` has been overwritten by one of the same length."""
        struct.pack_into("<I", self._entries, place * ENTRY.itemsize + 9, zlib.crc32(record))

    def to_bytes(self) -> bytes:
        """The entries of all records, one after the other."""
        return bytes(self._entries)

    def of_all(self) -> int:
        """CRC-32 of all records end to end."""
        entries = np.frombuffer(self._entries, ENTRY)
        return crc32_of_parts(entries["crc"], entries["length"].astype(np.int64))


def verify(data: memoryview) -> Verification:
    """Holds every record of a file against its checksum."""
    start, end = _find_list(data)
    if not end:
        return _without_list(data, start)
    entries = _entries(data, start, end)
    damages = list(_compare(data, entries, start))
    crc = crc32_of_parts(
        np.append(entries["crc"], np.uint32(zlib.crc32(data[start:end]))),
        np.append(entries["length"].astype(np.int64), end - start),
    )
    if data[end : end + _DATA_END.size] != _DATA_END.pack(Opcode.DATA_END, 4, crc):
        damages.append(DamagedRecord("the data end record", Opcode.DATA_END, end, end + _DATA_END.size))
    damages += _check_summary(data, end + _DATA_END.size)
    integrity = Integrity.DAMAGED if damages else Integrity.VERIFIED
    return Verification(integrity, len(entries) + 3, tuple(damages))


def _without_list(data: memoryview, mentioned: int) -> Verification:
    """No list can be read: it is damaged (its name stands at ``mentioned``), or none was written (0)."""
    if mentioned:
        damage = DamagedRecord(
            f"attachment {NAME!r}", Opcode.ATTACHMENT, mentioned - _NAME_OFFSET, mentioned + len(NAME)
        )
        return Verification(Integrity.DAMAGED, 0, (damage,))
    finished = data[-len(MAGIC) :] == MAGIC and len(data) > len(MAGIC)
    return Verification(Integrity.NO_CHECKSUMS if finished else Integrity.UNFINISHED, 0)


def _find_list(data: memoryview) -> tuple[int, int]:
    """Where the attachment with the list begins and ends.

    The end is 0 where no intact list is found; both are 0 where not even its name is found.
    """
    name, mentioned = re.compile(re.escape(NAME.encode())), 0
    for window in range(len(data), 0, -WINDOW):
        first = max(window - WINDOW, 0)
        for mark in name.finditer(data, first, min(window + len(NAME) - 1, len(data))):
            mentioned = mark.start()
            start = mentioned - _NAME_OFFSET
            if (end := _intact_attachment(data, start)) is not None:
                return start, end
        release(data, first, window)
    return mentioned, 0


def _intact_attachment(data: memoryview, start: int) -> int | None:
    """The end of the attachment at ``start``, if there is one and it agrees with its checksum."""
    if start < len(MAGIC):
        return None
    opcode, length = struct.unpack_from("<BQ", data, start)
    end = start + 9 + length
    if opcode != Opcode.ATTACHMENT or end > len(data) or length < 64:
        return None
    good = zlib.crc32(data[start + 9 : end - 4]) == struct.unpack_from("<I", data, end - 4)[0]
    return end if good else None


def _entries(data: memoryview, start: int, end: int) -> np.ndarray:
    """The list in its attachment: what stands behind name, media type and its own length, and before the checksum."""
    place = start + _NAME_OFFSET + len(NAME)
    (media_type,) = struct.unpack_from("<I", data, place)
    return np.frombuffer(data[place + 4 + media_type + 8 : end - 4], ENTRY)


def _compare(data: memoryview, entries: np.ndarray, stop: int) -> Iterator[DamagedRecord]:
    """Every record before the list; ``stop``: where the list begins."""
    place, released, seen = 0, 0, _Names()
    for opcode, length, crc in entries.tolist():
        name, record = seen.next(opcode), data[place : place + length]
        if len(record) < length or zlib.crc32(record) != crc:
            yield DamagedRecord(name + _title(opcode, record), opcode, place, place + length)
        place += length
        if (now := release(data, released, min(place, len(data)))) != released:
            released = now
            report("verifying checksums", place, stop)
    if place != stop:
        yield DamagedRecord("the records before the list of checksums", 0, min(place, stop), max(place, stop))


def _check_summary(data: memoryview, start: int) -> Iterator[DamagedRecord]:
    """The summary, the footer, and the magic at the end."""
    footer = len(data) - len(MAGIC) - _FOOTER.size
    if footer < start:
        yield DamagedRecord("the summary, which is cut off,", 0, min(start, len(data)), len(data))
        return
    opcode, length, summary, _, crc = _FOOTER.unpack_from(data, footer)
    if (opcode, length, summary) != (Opcode.FOOTER, 20, start):
        yield DamagedRecord("the footer", Opcode.FOOTER, footer, footer + _FOOTER.size)
    elif zlib.crc32(data[start : footer + _FOOTER.size - 4]) != crc:
        yield DamagedRecord("the summary or its checksum in the footer", 0, start, footer + _FOOTER.size)
    if data[-len(MAGIC) :] != MAGIC:
        yield DamagedRecord("the magic at the end", 0, len(data) - len(MAGIC), len(data))


class _Names:
    """What the records are called, numbered from 1 by kind."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}

    def next(self, opcode: int) -> str:
        count = self._counts[opcode] = self._counts.get(opcode, 0) + 1
        match opcode:
            case 0:
                return "the magic at the beginning"
            case Opcode.HEADER:
                return "the header"
            case Opcode.CHUNK:
                self._counts[Opcode.MESSAGE_INDEX] = 0
                return f"chunk {count}"
            case Opcode.MESSAGE_INDEX:
                return f"message index {count} of chunk {self._counts.get(Opcode.CHUNK, 0)}"
            case _:
                return f"{Opcode(opcode).name.lower()} {count}"


def _title(opcode: int, record: memoryview) -> str:
    """The name of an attachment or of metadata, as far as it can be read."""
    place = {Opcode.ATTACHMENT: 25, Opcode.METADATA: 9}.get(Opcode(opcode)) if opcode else None
    if place is None or len(record) < place + 4:
        return ""
    (length,) = struct.unpack_from("<I", record, place)
    return f" ({bytes(record[place + 4 : place + 4 + min(length, 40)]).decode(errors='replace')!r})"
