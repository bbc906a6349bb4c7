"""Tables as CSV, in and out: the columns of docs/recordings.md, every number to the last bit."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from arm_io import InputError, whole_file
from arm_io.files import open_regular
from arm_io.types import Array
from daq.recording.blocks import LongRecording
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.reader import Recording
from daq.recording.tables.csv_header import JOINT_COLUMN, joints_of, read_header
from daq.recording.tables.csv_time import TimeUnit, times_of

_LARGEST = 1e15
"""In rad, m, A, V or degC: nothing measures more, and squares of it are still numbers."""


@dataclass(frozen=True)
class Table:
    """n lines. Missing samples are NaN.

    t        (n,) s, strictly increasing; from 0 on where the file's times are of the epoch
    signals  'q', 'i', and whatever else of ``JOINT_TOPICS`` some joint has -> (n, J)
    xyz      (n, 3) m in the base frame, or None
    extra    further columns by name, (n,)
    epoch    s since 1970 of the first line, exactly, or None; start_ns: the same in ns, where ROS stamps can hold it
    """

    t: Array
    signals: dict[str, Array]
    xyz: Array | None
    extra: dict[str, Array]
    epoch: Decimal | None = None
    start_ns: int | None = None

    @property
    def joints(self) -> int:
        return self.signals["q"].shape[1]

    @property
    def rows_with_missing_samples(self) -> int:
        """Lines in which a column that has values elsewhere has none."""
        holes = [np.isnan(values) & ~np.isnan(values).all(axis=0) for values in self.signals.values()]
        holes += [] if self.xyz is None else [np.isnan(self.xyz)]
        return int(np.any([hole.any(axis=1) for hole in holes], axis=0).sum())


def read_csv(
    path: str | Path, *, joints: int | None = None, keep_extra: bool = False, unit: TimeUnit | None = None
) -> Table:
    """Reads a table. InputError names line and column, and what would be right.

    joints  that the rig has; None: as many as the table has columns q1, q2, ...
    unit    of the column t; None: s, and InputError where it looks like another
    """
    names, lines, cells = _cells(path, joints, keep_extra)
    columns = {name: _numbers(path, name, lines, column) for name, column in zip(names, cells)}
    times = times_of(path, lines, cells[names.index("t")], columns.pop("t"), unit)
    t, count = times.t, joints_of(path, names, joints, keep_extra)
    for name, values in columns.items():
        if (name in "xyz" or JOINT_COLUMN.fullmatch(name)) and (wrong := np.abs(values) > _LARGEST).any():
            row = int(np.argmax(wrong))
            raise InputError(
                path,
                f"line {lines[row]}, column {name}: {values[row]:g} is no measurement; a missing sample is an empty cell",
            )
    signals: dict[str, Array] = {}
    for name in list(columns):
        match = JOINT_COLUMN.fullmatch(name)
        if match is None:
            continue
        values = columns.pop(name)
        if np.isnan(values).all():
            raise InputError(path, f"column {name} has no value in any line; leave it out, or measure it")
        everyone = signals.setdefault(match[1], np.full((len(t), count), np.nan))
        everyone[:, int(match[2]) - 1] = values
    xyz = np.column_stack([columns.pop(axis) for axis in "xyz"]) if "x" in columns else None
    ordered = {name: signals[name] for name in JOINT_TOPICS if name in signals}
    return Table(t, ordered, xyz, columns, epoch=times.epoch, start_ns=times.start_ns)


def write_csv(path: str | Path, recording: Recording | LongRecording) -> list[str]:
    """Writes a recording as a table, whole or not at all; returns the names of the columns.

    Each number is the shortest text that reads back as the same float64; a missing sample is an empty cell. Tracker points
    that nobody can place in the base frame stay out.
    """
    names: list[str] = []
    epoch = recording.provenance.get("epoch")
    with whole_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        for block in recording.blocks():
            columns = _columns(block)
            if not names:
                names = list(columns)
                writer.writerow(names)
            writer.writerows(zip(*(_texts(values, epoch if name == "t" else None) for name, values in columns.items())))
    return names


def _columns(block: Recording) -> dict[str, Array]:
    """Column of the table -> (n,)."""
    columns: dict[str, Array] = {"t": block.t if block.time is None else block.time}
    for signal, having in block.layout.signals.items():
        values = getattr(block, signal)
        columns |= {f"{signal}{joint}": values[:, joint - 1] for joint in having}
    if block.xyz is not None:
        columns |= dict(zip("xyz", block.xyz.T))
    return columns | block.extra


def _texts(values: Array, since: str | None) -> Iterable[float | str]:
    """Numbers, of which ``csv`` writes the shortest text that reads back as the same float64; an empty text for NaN.

    since  what is added to each, exactly
    """
    if since is not None:
        return [str(Decimal(since) + Decimal(repr(value))) for value in values.tolist()]
    if not np.isnan(values).any():
        return values.tolist()
    return ("" if value != value else value for value in values.tolist())


def _cells(
    path: str | Path, joints: int | None, keep_extra: bool
) -> tuple[list[str], list[int], list[tuple[str, ...]]]:
    """Column names, the number of each line with cells, and the cells by column. The names are checked before a row is read."""
    try:
        with os.fdopen(open_regular(path), encoding="utf-8-sig", newline="") as file:
            names = read_header(path, file)
            joints_of(path, names, joints, keep_extra)
            reader = csv.reader(file)
            rows = [(reader.line_num + 1, row) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read as a CSV text in UTF-8: {error}") from None
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(path, f"line {line}: has {len(row)} cells, the first line names {len(names)} columns")
    if len(rows) < 2:
        raise InputError(path, f"has {len(rows)} lines of numbers; at least 2 are wanted")
    return names, [line for line, _ in rows], list(zip(*(row for _, row in rows)))


def _numbers(path: str | Path, name: str, lines: Sequence[int], cells: Sequence[str]) -> Array:
    try:
        values = np.array([float(cell or "nan") for cell in cells])
        sure = not np.isinf(values).any() and not any("_" in cell for cell in cells)
    except ValueError:
        sure = False
    return values if sure else np.array([_number(path, name, line, cell.strip()) for line, cell in zip(lines, cells)])


def _number(path: str | Path, name: str, line: int, cell: str) -> float:
    """One cell, slowly, to say which one is wrong."""
    try:
        value = float(cell.replace("_", "?") or "nan")
    except ValueError:
        raise InputError(path, f"line {line}, column {name}: {cell!r} is no number") from None
    if np.isinf(value):
        raise InputError(path, f"line {line}, column {name}: {cell!r} is not finite; a missing sample is an empty cell")
    return value
