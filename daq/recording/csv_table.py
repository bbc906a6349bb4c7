"""Tables as CSV, in and out: the columns of docs/recordings.md, every number to the last bit."""

from __future__ import annotations

import csv
import difflib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_io import InputError, whole_file
from arm_io.files import open_regular
from arm_io.types import Array
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.reader import Recording

_JOINT_COLUMN = re.compile(rf"({'|'.join(JOINT_TOPICS)})([1-9][0-9]*)")
_LARGEST = 1e15
"""In rad, m, A, V or degC: nothing measures more, and squares of it are still numbers."""
_KNOWN = "t, q1.., i1.., qref1.., ql1.., v1.., temp1.., x, y, z"


@dataclass(frozen=True)
class Table:
    """n lines. Missing samples are NaN.

    t        (n,) s, strictly increasing
    signals  'q', 'i', and whatever else of ``JOINT_TOPICS`` some joint has -> (n, J)
    xyz      (n, 3) m in the base frame, or None
    extra    further columns by name, (n,)
    """

    t: Array
    signals: dict[str, Array]
    xyz: Array | None
    extra: dict[str, Array]

    @property
    def joints(self) -> int:
        return self.signals["q"].shape[1]

    @property
    def rows_with_missing_samples(self) -> int:
        """Lines in which a column that has values elsewhere has none."""
        holes = [np.isnan(values) & ~np.isnan(values).all(axis=0) for values in self.signals.values()]
        holes += [] if self.xyz is None else [np.isnan(self.xyz)]
        return int(np.any([hole.any(axis=1) for hole in holes], axis=0).sum())


def read_csv(path: str | Path, *, joints: int | None = None, keep_extra: bool = False) -> Table:
    """Reads a table. InputError names line and column, and what would be right.

    joints  that the rig has; None: as many as the table has columns q1, q2, ...
    """
    names, lines, cells = _cells(path)
    count = _check_names(path, names, joints, keep_extra)
    columns = {name: _numbers(path, name, lines, column) for name, column in zip(names, cells)}
    t = columns.pop("t")
    _check_time(path, lines, t)
    for name, values in columns.items():
        if (name in "xyz" or _JOINT_COLUMN.fullmatch(name)) and (wrong := np.abs(values) > _LARGEST).any():
            row = int(np.argmax(wrong))
            raise InputError(
                path,
                f"line {lines[row]}, column {name}: {values[row]:g} is no measurement; a missing sample is an empty cell",
            )
    signals: dict[str, Array] = {}
    for name in list(columns):
        match = _JOINT_COLUMN.fullmatch(name)
        if match is None:
            continue
        values = columns.pop(name)
        if np.isnan(values).all():
            raise InputError(path, f"column {name} has no value in any line; leave it out, or measure it")
        everyone = signals.setdefault(match[1], np.full((len(t), count), np.nan))
        everyone[:, int(match[2]) - 1] = values
    xyz = np.column_stack([columns.pop(axis) for axis in "xyz"]) if "x" in columns else None
    return Table(t, {name: signals[name] for name in JOINT_TOPICS if name in signals}, xyz, columns)


def write_csv(path: str | Path, recording: Recording) -> list[str]:
    """Writes a recording as a table, whole or not at all; returns the names of the columns.

    Each number is the shortest text that reads back as the same float64; a missing sample is an empty cell. Tracker points
    that nobody can place in the base frame stay out.
    """
    columns: dict[str, Array] = {"t": recording.t if recording.time is None else recording.time}
    for signal, having in recording.layout.signals.items():
        values = getattr(recording, signal)
        columns |= {f"{signal}{joint}": values[:, joint - 1] for joint in having}
    if recording.xyz is not None:
        columns |= dict(zip("xyz", recording.xyz.T))
    columns |= recording.extra
    with whole_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(_texts(values) for values in columns.values())))
    return list(columns)


def _texts(values: Array) -> Iterator[str]:
    return ("" if value != value else repr(value) for value in values.tolist())


def _cells(path: str | Path) -> tuple[list[str], list[int], list[tuple[str, ...]]]:
    """Column names, the number of each line with cells, and the cells by column."""
    try:
        with os.fdopen(open_regular(path), encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            names = [name.strip() for name in next(reader, [])]
            rows = [(reader.line_num, row) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read as a CSV text in UTF-8: {error}") from None
    if len(names) == 1 and (found := re.search(r"[;\t|]", names[0])):
        raise InputError(path, f"columns are separated by {found[0]!r}; commas are wanted, and decimal points")
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(path, f"line {line}: has {len(row)} cells, the first line names {len(names)} columns")
    if len(rows) < 2:
        raise InputError(path, f"has {len(rows)} lines of numbers; at least 2 are wanted")
    return names, [line for line, _ in rows], list(zip(*(row for _, row in rows)))


def _check_names(path: str | Path, names: Sequence[str], joints: int | None, keep_extra: bool) -> int:
    """The number of joints, if the columns are as they should be."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(path, f"line 1: column {name!r} is there twice")
    by_joint = [match for name in names if (match := _JOINT_COLUMN.fullmatch(name))]
    count = joints or max((int(match[2]) for match in by_joint if match[1] == "q"), default=1)
    wanted = ["t", *(f"{signal}{joint}" for joint in range(1, count + 1) for signal in "qi")]
    missing = [name for name in wanted if name not in names]
    known = {*wanted, *"xyz", *(f"{signal}{joint}" for signal in JOINT_TOPICS for joint in range(1, count + 1))}
    unknown = [name for name in names if name not in known]
    if missing:
        close = difflib.get_close_matches(missing[0], unknown, 1, 0.5)
        hint = f"; is it {close[0]!r}?" if close else ""
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        rig = f"; the rig has {joints} joint{'s' * (joints > 1)}" if joints else ""
        raise InputError(path, f"line 1: column {missing[0]} is missing{more}{hint or rig}")
    for match in by_joint:
        if match[0] in unknown:
            owner = "the rig" if joints else "the table (columns q1, q2, ...)"
            raise InputError(path, f"line 1: column {match[0]}, but {owner} has {count} joint{'s' * (count > 1)}")
    if unknown and not keep_extra:
        raise InputError(
            path, f"line 1: column {unknown[0]!r} is unknown; known are {_KNOWN}; --keep-extra keeps others"
        )
    if 0 < sum(axis in names for axis in "xyz") < 3:
        raise InputError(path, "line 1: of the tracker's columns x, y, z all three are wanted, or none")
    return count


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


def _check_time(path: str | Path, lines: Sequence[int], t: Array) -> None:
    if np.isnan(t).any():
        line = lines[int(np.argmax(np.isnan(t)))]
        raise InputError(path, f"line {line}, column t: is missing; every line wants its time")
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        row = int(back[0]) + 1
        raise InputError(
            path, f"line {lines[row]}: t goes from {t[row - 1]:.9g} to {t[row]:.9g}; it wants to increase strictly"
        )
    if t[-1] - t[0] >= 2**31:
        raise InputError(path, f"t spans {t[-1] - t[0]:.3g} s; is it in s?")
