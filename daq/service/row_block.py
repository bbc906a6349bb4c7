"""A block of rows on the wire: a fixed head, a description of the columns, the columns. Readable without armscope.

All little endian. Head, 56 bytes:

    offset  type     field
    0       4 bytes  b"ARMR"
    4       u16      version of this layout, 1
    6       u16      flags; bit 0: the last block of its run (it may have no rows)
    8       u32      length of the description in bytes
    12      u32      n, rows in this block
    16      u64      sequence: number of the block in its run, from 0
    24      u64      before: rows in all earlier blocks of the run
    32      16 bytes run: a UUID, new for every recording or replay
    48      u64      reserved, 0

Then the description: JSON in UTF-8, padded with blanks to a multiple of 8 bytes, ``{"columns": [{"name", "type",
"shape", "unit"}, ...], "joints": [...]}``; ``type`` is numpy's (``<i8``, ``<f8``, ``|u1``), ``shape`` that of one row.
Then the columns in that order, each C-contiguous (n, *shape) and padded with zeros to a multiple of 8 bytes.

``sequence`` and ``before`` give a receiver the exact number of missed blocks and rows; the description is the same in
all blocks of a run, so that it is parsed once.
"""

from __future__ import annotations

import json
import math
import struct
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.rows import Rows
from daq.recording.messages.row_format import POSE_COLUMNS
from daq.recording.messages.viewers import held

HEAD = struct.Struct("<4sHHIIQQ16sQ")
MAGIC = b"ARMR"
VERSION = 1
LAST = 1
MEDIA_TYPE = "application/x-armscope-rows;version=1"

UNITS = {
    "t": "s",
    "host_ns": "ns",
    "wall_ns": "ns",
    "volts": "V",
    "points": "m",
    "xyz": "m",
    "q": "rad|m",
    "ql": "rad|m",
    "qref": "rad|m",
    "i": "A",
    "v": "V",
    "temp": "degC",
}
"""Units of the columns that have one; names as in ``daq.recording.reader.Recording``."""

Columns = Mapping[str, NDArray]


@dataclass(frozen=True, slots=True)
class RowBlock:
    """A block as received.

    run      UUID of the run, 32 hexadecimal digits
    columns  name -> (rows, ...): read-only views of the message
    """

    run: str
    sequence: int
    before: int
    last: bool
    joints: tuple[str, ...]
    columns: Columns
    rows: int


def columns_of(rows: Rows) -> dict[str, NDArray]:
    """The columns (rows, ...) of a block of the sampler, under the names that they have in a Recording."""
    columns = {name: getattr(rows, name) for name in Rows.__dataclass_fields__ if name != "extra"}
    return rows.extra | {name: values for name, values in columns.items() if values is not None}


def describe(columns: Columns, joints: Sequence[str]) -> bytes:
    """The description of columns such as these, padded."""
    table = {
        "columns": [
            {"name": name, "type": values.dtype.newbyteorder("<").str, "shape": list(values.shape[1:])}
            | ({"unit": UNITS[name]} if name in UNITS else {})
            for name, values in columns.items()
        ],
        "joints": list(joints),
    }
    text = json.dumps(table, separators=(",", ":")).encode()
    return text + b" " * (-len(text) % 8)


def encode(columns: Columns, description: bytes, run: uuid.UUID, sequence: int, before: int, *, last: bool) -> bytes:
    """The bytes of one block; ``columns`` all have the same number of rows, and the dtypes of ``description``."""
    rows = len(next(iter(columns.values())))
    parts: list[bytes | memoryview] = [
        HEAD.pack(MAGIC, VERSION, LAST if last else 0, len(description), rows, sequence, before, run.bytes, 0),
        description,
    ]
    for values in columns.values():
        parts += (np.ascontiguousarray(values).data.cast("B") if values.size else b"", bytes(-values.nbytes % 8))
    return b"".join(parts)


def decode(data: bytes) -> RowBlock:
    """The block in a message; ValueError says what is wrong with one that is none."""
    if len(data) < HEAD.size:
        raise ValueError(f"{len(data)} bytes are no row block: its head alone has {HEAD.size}")
    magic, version, flags, length, rows, sequence, before, run, _ = HEAD.unpack_from(data)
    if magic != MAGIC:
        raise ValueError(f"starts with {magic!r}, a row block with {MAGIC!r}")
    if version != VERSION:
        raise ValueError(f"is of version {version}; this reader knows {VERSION}")
    start = HEAD.size + length
    joints, layout = _layout(data[HEAD.size : start], rows)
    if len(data) < start + layout.itemsize:
        raise ValueError(f"has {len(data)} bytes; its columns need {start + layout.itemsize}")
    columns = _Columns(np.ndarray((), layout, data, start))
    return RowBlock(run.hex(), sequence, before, bool(flags & LAST), joints, columns, rows)


class _Columns(Mapping[str, NDArray]):
    """The columns of a message, each made into an array when it is asked for."""

    def __init__(self, record: NDArray) -> None:
        self._record = record

    def __getitem__(self, name: str) -> NDArray:
        if name not in (self._record.dtype.names or ()):
            raise KeyError(name)
        return self._record[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._record.dtype.names or ())

    def __len__(self) -> int:
        return len(self._record.dtype.names or ())


@lru_cache(maxsize=64)
def _layout(description: bytes, rows: int) -> tuple[tuple[str, ...], np.dtype]:
    """Joints, and the columns of so many rows as one structured type."""
    joints, fields = _parse(description)
    names, forms, offsets, offset = [], [], [], 0
    for name, form, shape in fields:
        names.append(name)
        forms.append((form, (rows, *shape)))
        offsets.append(offset)
        offset += form.itemsize * rows * math.prod(shape)
        offset += -offset % 8
    if offset >= 2**31:
        raise ValueError(f"claims {offset} bytes of columns")
    return joints, np.dtype({"names": names, "formats": forms, "offsets": offsets, "itemsize": offset})


def _parse(description: bytes) -> tuple[tuple[str, ...], list[tuple[str, np.dtype, tuple[int, ...]]]]:
    try:
        table = json.loads(description)
        fields = [
            (str(column["name"]), _number(column["type"]), tuple(map(_size, column["shape"])))
            for column in table["columns"]
        ]
        return tuple(map(str, table["joints"])), fields
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"has an unreadable description of its columns: {error}") from None


def _number(form: str) -> np.dtype:
    dtype = np.dtype(str(form))
    if dtype.kind not in "iuf":
        raise ValueError(f"{form!r} is no type of numbers")
    return dtype


def _size(length: int) -> int:
    if not 0 <= int(length) < 2**16:
        raise ValueError(f"a shape has {length}")
    return int(length)


def poses_of(columns: Columns, before: NDArray[np.float64]) -> NDArray[np.float64]:
    """(rows, 7) x y z m, quaternion x y z w of a floating base, the last known values where a row lacks them.

    ``before`` (7,) those of the block before. (0, 7) where the columns lack it.
    """
    if not all(name in columns for name in POSE_COLUMNS):
        return np.empty((0, len(POSE_COLUMNS)))
    return held(np.column_stack([columns[name] for name in POSE_COLUMNS]), before)
