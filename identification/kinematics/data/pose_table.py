"""A table of poses, as laboratories have it: joint angles and the tracked point, no times and no currents."""

from __future__ import annotations

import csv
import os
import re
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular
from arm_io.types import Array
from identification.kinematics.data.recordings import Tracked
from identification.kinematics.data.runs import Run

HOLDS = "q1, q2, .. (rad; m of prismatic joints) and x, y, z (m), one row per pose; t, i1, .. and others may be there"
"""What a table of poses must hold, for messages and help."""
LARGEST_ANGLE, LARGEST_LENGTH = 30.0, 100.0
"""rad and m: more is degrees, or mm."""
_ANGLE = re.compile(r"q[1-9][0-9]?")
_SEVERAL = re.compile(r"[xyz][1-9][0-9]?")


def read_poses(path: Path, joints: int) -> Tracked:
    """The poses of a table in CSV for an arm of ``joints`` joints, each measured at rest.

    With a column t (s, increasing) the rows are those of a motion. An empty cell or nan is a missing value. The frame
    of the tracker is taken as unknown, and so is the target. InputError: a column is missing or no number, more than
    one reflector, or another unit.
    """
    names, cells = _read(path)
    if found := [name for name in names if _SEVERAL.fullmatch(name)]:
        raise InputError(
            path,
            f"column {found[0]}: several reflectors per pose are not supported; must hold one, as x, y, z: calibrate "
            "each reflector from a table of its own",
        )
    needed = [*(f"q{j}" for j in range(1, joints + 1)), "x", "y", "z"]
    if missing := [name for name in needed if name not in names]:
        raise InputError(path, f"column {missing[0]} is missing; a table of poses of this arm must hold {HOLDS}")
    if (more := f"q{joints + 1}") in names:
        raise InputError(path, f"column {more}: the model has {joints} joints")
    table = _numbers(path, names, cells, [*needed, "t"] if "t" in names else needed)
    q, xyz = table[:, :joints], table[:, joints : joints + 3]
    _check_units(path, q, xyz)
    if "t" not in names:
        return Tracked(Run(path.name, np.arange(len(q), dtype=float), q, xyz, still=True), False, None, "")
    t = table[:, -1]
    if not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError(path, "column t must hold strictly increasing times, s; omit it for poses measured at rest")
    return Tracked(Run(path.name, t, q, xyz), False, None, "")


def _read(path: Path) -> tuple[list[str], list[list[str]]]:
    try:
        with os.fdopen(open_regular(path), newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read as a CSV table: {getattr(error, 'strerror', None) or error}") from None
    names = [cell.strip() for cell in rows[0]] if rows else []
    if len(names) == 1 and (mark := re.search(r"[;\t|]", names[0])):
        raise InputError(path, f"columns are separated by {mark[0]!r}; use commas, and decimal points")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(path, f"line 1: column {repeated[0]!r} is there twice")
    return names, rows[1:]


def _numbers(path: Path, names: list[str], cells: list[list[str]], wanted: list[str]) -> Array:
    """(rows, wanted) numbers; NaN where a cell is empty."""
    table = np.full((len(cells), len(wanted)), np.nan)
    columns = [names.index(name) for name in wanted]
    for number, row in enumerate(cells):
        for k, column in enumerate(columns):
            text = row[column].strip() if column < len(row) else ""
            try:
                table[number, k] = float(text) if text else np.nan
            except ValueError:
                raise InputError(path, f"line {number + 2}: {wanted[k]}: {text[:40]!r} is no number") from None
            if np.isinf(table[number, k]):
                raise InputError(path, f"line {number + 2}: {wanted[k]}: must be finite; leave out what is missing")
    return table


def _check_units(path: Path, q: Array, xyz: Array) -> None:
    for name, values, largest, unit in (("q", q, LARGEST_ANGLE, "rad"), ("x, y, z", xyz, LARGEST_LENGTH, "m")):
        high = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
        if high > largest:
            other = "degrees" if unit == "rad" else "mm"
            raise InputError(path, f"{name}: {high:.4g} is no value in {unit}; must be in {unit}, not in {other}")
