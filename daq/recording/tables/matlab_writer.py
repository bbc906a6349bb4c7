"""A recording as .mat of version 5: t (n, 1), and one matrix (n, joints) per signal, block by block.

The format is that of "MAT-File Format" (The MathWorks), level 5, uncompressed: a matrix stands in it column by column,
so that the place of every number is known before the first is written, and nothing but a block is in memory.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from arm_io import InputError, whole_path
from arm_io.types import Array
from daq.recording.blocks import LongRecording
from daq.recording.reader import Recording

_HEAD = b"MATLAB 5.0 MAT-file, made by armscope"
_DOUBLE, _INT8, _INT32, _UINT32, _MATRIX, _UTF8 = 9, 1, 5, 6, 14, 16
_CELL_CLASS, _CHAR_CLASS, _DOUBLE_CLASS = 1, 4, 6
EXTRA, EXTRA_NAMES = "extra", "extra_names"
"""Further columns (n, k), and a cell array (k, 1) of their names."""
LARGEST = (1 << 31) - 1
"""Bytes of a matrix that MATLAB reads."""


def write_matlab(path: str | Path, recording: LongRecording) -> list[str]:
    """Writes a recording, whole or not at all; returns the names of the matrices. NaN: missing sample.

    A joint without a signal has NaN in its matrix; x, y, z of a tracker are xyz (n, 3); further columns are ``EXTRA``.
    InputError where a matrix is too large for the format, or the file cannot be written.
    """
    widths = {name: values.shape[1] for name, values in _matrices(next(recording.blocks())).items()}
    rows = len(recording)
    for name, width in widths.items():
        if 8 * rows * width > LARGEST - 1000:
            raise InputError(path, f"{name} has {8 * rows * width >> 20} MB, and .mat holds 2 GB; export .parquet")
    with whole_path(path) as place, place.open("wb") as file:
        file.write(_HEAD.ljust(124) + struct.pack("<H2s", 0x0100, b"IM"))
        places = {}
        for name, width in widths.items():
            file.write(_matrix_head(name, rows, width))
            places[name] = file.tell()
            file.seek(8 * rows * width, 1)
        if recording.layout.extra:
            file.write(_cells(EXTRA_NAMES, recording.layout.extra))
        file.truncate()
        row = 0
        for block in recording.blocks():
            for name, values in _matrices(block).items():
                for column in range(widths[name]):
                    file.seek(places[name] + 8 * (column * rows + row))
                    file.write(values[:, column].astype("<f8").tobytes())
            row += len(block)
    return list(widths)


def _matrices(block: Recording) -> dict[str, Array]:
    """Name -> (n, columns)."""
    t = block.t if block.time is None else block.time
    matrices = {"t": t[:, None]}
    matrices |= {signal: getattr(block, signal) for signal in block.layout.signals}
    if block.xyz is not None:
        matrices["xyz"] = block.xyz
    if block.extra:
        matrices[EXTRA] = np.column_stack(list(block.extra.values()))
    return matrices


def _matrix_head(name: str, rows: int, width: int) -> bytes:
    """All of a matrix of doubles ahead of its numbers."""
    head = _array(_DOUBLE_CLASS, name, rows, width) + struct.pack("<II", _DOUBLE, 8 * rows * width)
    return struct.pack("<II", _MATRIX, len(head) + 8 * rows * width) + head


def _cells(name: str, texts: Sequence[str]) -> bytes:
    """A cell array (k, 1) of strings."""
    content = _array(_CELL_CLASS, name, len(texts), 1)
    for text in texts:
        content += _element(_MATRIX, _array(_CHAR_CLASS, "", 1, len(text)) + _element(_UTF8, text.encode()))
    return _element(_MATRIX, content)


def _array(kind: int, name: str, rows: int, width: int) -> bytes:
    """Class, size and name, with which every array begins."""
    size = _element(_INT32, struct.pack("<ii", rows, width))
    return _element(_UINT32, struct.pack("<II", kind, 0)) + size + _element(_INT8, name.encode())


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)
