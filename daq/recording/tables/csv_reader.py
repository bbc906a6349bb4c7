"""Tables as CSV, read block by block: the columns of docs/recordings.md, every number to the last bit."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import TextIO

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular
from arm_io.types import Array
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.tables.csv_header import JOINT_COLUMN, joints_of, read_header
from daq.recording.tables.csv_time import TimeColumn, TimeUnit

BLOCK_CHARACTERS = 1 << 20
"""Of the text that is read at once."""
_LARGEST = 1e15
"""In rad, m, A, V or degC: nothing measures more, and squares of it are still numbers."""
_TAIL = 1 << 16


@dataclass(frozen=True)
class Table:
    """n lines, all of a file or some. Missing samples are NaN.

    t        (n,) s, strictly increasing; from 0 on where the file's times are of the epoch
    signals  'q', 'i', and whatever else of ``JOINT_TOPICS`` some joint has -> (n, J)
    having   the same signals -> joints with a column, numbered from 1
    xyz      (n, 3) m in the base frame, or None
    extra    further columns by name, (n,)
    epoch    s since 1970 of the file's first line, exactly, or None; start_ns: the same in ns, where ROS stamps can
             hold it
    """

    t: Array
    signals: dict[str, Array]
    having: dict[str, tuple[int, ...]]
    xyz: Array | None
    extra: dict[str, Array]
    epoch: Decimal | None = None
    start_ns: int | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def joints(self) -> int:
        return self.signals["q"].shape[1]

    @property
    def rows_with_missing_samples(self) -> int:
        """Lines in which a column has no value."""
        holes = [np.isnan(values[:, np.array(self.having[name]) - 1]) for name, values in self.signals.items()]
        holes += [] if self.xyz is None else [np.isnan(self.xyz)]
        return int(np.any([hole.any(axis=1) for hole in holes], axis=0).sum())


def read_csv(
    path: str | Path, *, joints: int | None = None, keep_extra: bool = False, unit: TimeUnit | None = None
) -> Table:
    """Reads a table whole; arguments and errors as ``read_csv_blocks`` has them."""
    blocks = list(read_csv_blocks(path, joints=joints, keep_extra=keep_extra, unit=unit))
    first = blocks[0]
    return replace(
        first,
        t=np.concatenate([block.t for block in blocks]),
        signals={name: np.concatenate([block.signals[name] for block in blocks]) for name in first.signals},
        xyz=None if first.xyz is None else np.concatenate([block.xyz for block in blocks if block.xyz is not None]),
        extra={name: np.concatenate([block.extra[name] for block in blocks]) for name in first.extra},
    )


def read_csv_blocks(
    path: str | Path, *, joints: int | None = None, keep_extra: bool = False, unit: TimeUnit | None = None
) -> Iterator[Table]:
    """Reads a table, a bounded number of lines at a time. InputError names line and column, and what would be right.

    joints  that the rig has; None: as many as the table has columns q1, q2, ...
    unit    of the column t; None: s, and InputError where it looks like another
    """
    try:
        with os.fdopen(open_regular(path), encoding="utf-8-sig", newline="") as file:
            names = read_header(path, file)
            count = joints_of(path, names, joints, keep_extra)
            times = TimeColumn(path, unit, _last_cell(path, names.index("t")))
            empty, rows = {name for name in names if JOINT_COLUMN.fullmatch(name)}, 0
            for lines, cells, plain in _blocks(path, file, len(names)):
                columns = {name: _numbers(path, name, lines, column, plain=plain) for name, column in zip(names, cells)}
                t = times.seconds(lines, cells[names.index("t")], columns.pop("t"))
                _check_size(path, lines, columns)
                empty = {name for name in empty if np.isnan(columns[name]).all()}
                rows += len(t)
                yield replace(_table(t, columns, count), epoch=times.epoch, start_ns=times.start_ns)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read as a CSV text in UTF-8: {error}") from None
    if rows < 2:
        raise InputError(path, f"has {rows} lines of numbers; there must be at least 2")
    for name in names:
        if name in empty:
            raise InputError(path, f"column {name} has no value in any line; omit it, or measure it")


def _table(t: Array, columns: dict[str, Array], joints: int) -> Table:
    """Columns by name in their places."""
    signals: dict[str, Array] = {}
    having: dict[str, tuple[int, ...]] = {}
    for name in JOINT_TOPICS:
        there = [joint for joint in range(1, joints + 1) if f"{name}{joint}" in columns]
        if there:
            having[name] = tuple(there)
            signals[name] = np.full((len(t), joints), np.nan)
            for joint in there:
                signals[name][:, joint - 1] = columns[f"{name}{joint}"]
    xyz = np.column_stack([columns[axis] for axis in "xyz"]) if "x" in columns else None
    known = {"x", "y", "z", *(f"{name}{joint}" for name, there in having.items() for joint in there)}
    return Table(t, signals, having, xyz, {name: values for name, values in columns.items() if name not in known})


def _blocks(path: str | Path, file: TextIO, width: int) -> Iterator[tuple[list[int], list[tuple[str, ...]], bool]]:
    """The number of each line with cells, the cells by column, and whether all of them read as they look."""
    line = 1
    while text := file.readlines(BLOCK_CHARACTERS):
        reader = csv.reader(text)
        rows = [(line + reader.line_num, row) for row in reader if row]
        for number, row in rows:
            if len(row) != width:
                raise InputError(path, f"line {number}: has {len(row)} cells, the first line names {width} columns")
        if rows:
            plain = not any("_" in one for one in text)
            yield [number for number, _ in rows], list(zip(*(row for _, row in rows))), plain
        line += len(text)


def _last_cell(path: str | Path, column: int) -> str:
    """The text in a column of the last line; "" where it is unknown."""
    with os.fdopen(open_regular(path), "rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - _TAIL, 0))
        lines = file.read().decode(errors="replace").split("\n")
    cells = next((line for line in reversed(lines) if line.strip()), "").split(",")
    return cells[column].strip() if column < len(cells) else ""


def _numbers(path: str | Path, name: str, lines: Sequence[int], cells: Sequence[str], *, plain: bool) -> Array:
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:
        try:
            values = np.array([float(cell or "nan") for cell in cells])
        except ValueError:
            plain = False
    if plain and not np.isinf(values).any():
        return values
    return np.array([_number(path, name, line, cell.strip()) for line, cell in zip(lines, cells)])


def _number(path: str | Path, name: str, line: int, cell: str) -> float:
    """One cell, slowly, to say which one is wrong."""
    try:
        value = float(cell.replace("_", "?") or "nan")
    except ValueError:
        raise InputError(path, f"line {line}, column {name}: {cell!r} is no number") from None
    if np.isinf(value):
        raise InputError(path, f"line {line}, column {name}: {cell!r} is not finite; a missing sample is an empty cell")
    return value


def _check_size(path: str | Path, lines: Sequence[int], columns: dict[str, Array]) -> None:
    for name, values in columns.items():
        if (name in "xyz" or JOINT_COLUMN.fullmatch(name)) and (wrong := np.abs(values) > _LARGEST).any():
            row = int(np.argmax(wrong))
            raise InputError(
                path,
                f"line {lines[row]}, column {name}: {values[row]:g} is not a measurement; a missing sample is an "
                "empty cell",
            )
