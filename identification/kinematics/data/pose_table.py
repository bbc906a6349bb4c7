"""A table of poses, as laboratories have it: joint angles and tracked targets, no times and no currents."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from arm_io import counted
from arm_io.types import Array
from identification.kinematics.data.points import FIRST_LEVER
from identification.kinematics.data.pose_table_cells import Cells, read_cells
from identification.kinematics.data.recordings import Sighting, Tracked
from identification.kinematics.data.runs import Run
from identification.kinematics.models.chain import Index

HOLDS = (
    "q1, q2, .. (rad; m of prismatic joints) and x, y, z (m), one row per pose; several reflectors as x1, y1, z1, x2, "
    ".. or as rows with a column reflector; orientations as qw, qx, qy, qz or rx, ry, rz or roll, pitch, yaw (rad); "
    "other units in the names (q1 [deg], x [mm]); t, i1, .. and others may be there"
)
"""What a table of poses must hold, for messages and help."""
LARGEST_ANGLE = 30.0
"""rad: larger angles are degrees."""
LARGEST_LENGTH = 100.0
"""m: larger lengths are mm."""
POINT = ("x", "y", "z")
"""Columns of the tracked point, m."""
PLACE = ("target_x", "target_y", "target_z")
"""Columns of the reflector's place in the frame of the last link, m."""
QUATERNION = ("qw", "qx", "qy", "qz")
"""Columns of an orientation: a unit quaternion."""
VECTOR = ("rx", "ry", "rz")
"""The same as a rotation vector, rad."""
ANGLES = ("roll", "pitch", "yaw")
"""The same as Rot(z, yaw) Rot(y, pitch) Rot(x, roll), rad."""
_NUMBERED = re.compile(r"x([1-9][0-9]?)")


@dataclass(frozen=True)
class _Seen:
    """One reflector over the poses: xyz (N, 3) m, turn (N, 3) rad or None, its place on the link (3,) m or None."""

    name: str
    xyz: Array
    turn: Array | None
    place: tuple[float, float, float] | None


def read_poses(path: Path, joints: int) -> Tracked:
    """The poses of a table in CSV for an arm of ``joints`` joints, each measured at rest.

    Names of other programs, and lines above the names, are accepted (``pose_table_names``); ``notes`` says so.
    With a column t (s, increasing) the rows are those of a motion. An empty cell or nan is a missing value: a reflector
    that was not seen. The frame of the tracker is taken as unknown. InputError: a column is missing or no number, or in
    another unit.
    """
    table = read_cells(path)
    angles = [f"q{j}" for j in range(1, joints + 1)]
    numbered = sorted({int(m[1]) for name in table.names if (m := _NUMBERED.fullmatch(name))})
    suffixes = [str(k) for k in numbered] or [""]
    needed = [*angles, *(f"{axis}{suffix}" for suffix in suffixes for axis in POINT)]
    if missing := [name for name in needed if name not in table.names]:
        raise table.error(f"column {missing[0]} is missing; a table of poses of this arm must hold {HOLDS}")
    if (more := f"q{joints + 1}") in table.names:
        raise table.error(f"column {more}: the model has {counted(joints, 'joint')}")
    if numbered and ("x" in table.names or "reflector" in table.names):
        other = "x" if "x" in table.names else "reflector"
        raise table.error(f"has columns {other} and x{numbered[0]}; must have one row per pose with x1, y1, z1, .., "
                          "or x, y, z with a column reflector")  # fmt: skip
    q = table.numbers(angles)
    for name, column in zip(angles, q.T, strict=True):
        high = float(np.max(np.abs(column[np.isfinite(column)]), initial=0.0))
        if high > LARGEST_ANGLE:
            raise table.error(f"{name}: {high:.4g} is no value in rad, nor in m of a prismatic joint; where it is in "
                              f"another unit, its name must say so, as in {name} [deg] or {name} [mm]")  # fmt: skip
    seen = [_reflector(table, suffix) for suffix in suffixes]
    rows: Index = np.arange(len(q))
    if "reflector" in table.names:
        if "t" in table.names:
            raise table.error("has columns t and reflector; a motion must have one row per time, with x1, y1, z1, ..")
        seen, rows = _by_name(table, q, seen[0])
        q = q[rows]
    return _tracked(table, q, rows, seen)


def _tracked(table: Cells, q: Array, rows: Index, seen: list[_Seen]) -> Tracked:
    """One run per reflector, and one more for its orientations; rows (N,) of the table that each pose begins at."""
    still, name = "t" not in table.names, table.path.name
    t = rows.astype(float) if still else table.numbers(["t"])[:, 0]
    if not still and (not np.isfinite(t).all() or (np.diff(t) <= 0).any()):
        raise table.error("column t must hold strictly increasing times, s; omit it for poses measured at rest")
    runs, numbered = [], len(seen) > 1
    for number, one in enumerate(seen):
        label = f"{name} reflector {one.name}" if numbered else name
        run = Run(label, t, q, one.xyz, still=still, target=number, recorded=name, file_row=rows)
        runs.append(run)
        if one.turn is not None:
            runs.append(Run(f"{label} orientation", t, q, one.turn, None, still, number, FIRST_LEVER, name, rows))
    sightings = tuple(Sighting(one.name, one.place, one.turn is not None) for one in seen)
    return Tracked(tuple(runs), False, sightings, "", notes=(f"{name}: {table.said}",) if table.said else ())


def _reflector(table: Cells, suffix: str) -> _Seen:
    """The reflector whose columns end in ``suffix``."""
    xyz = table.numbers([axis + suffix for axis in POINT])
    _check_unit(table, ", ".join(axis + suffix for axis in POINT), xyz, LARGEST_LENGTH, "m", "mm")
    place = None
    if all(name + suffix in table.names for name in PLACE):
        values = table.numbers([name + suffix for name in PLACE])
        values = values[np.isfinite(values).all(axis=1)]
        if "reflector" not in table.names:
            place = _one_place(table, values)
    return _Seen(suffix, xyz, _orientation(table, suffix), place)


def _one_place(table: Cells, values: Array) -> tuple[float, float, float] | None:
    """The place that all rows (N, 3) m give, or None."""
    if not len(values):
        return None
    if np.ptp(values, axis=0).max() > 0:
        raise table.error("target_x, target_y, target_z: must be the same in all rows of a reflector (its place on the "
                          "last link, m)")  # fmt: skip
    _check_unit(table, "target_x, target_y, target_z", values, LARGEST_LENGTH, "m", "mm")
    x, y, z = (float(v) for v in values[0])
    return x, y, z


def _orientation(table: Cells, suffix: str) -> Array | None:
    """(N, 3) rad rotation vectors of the target's frame in that of the tracker, or None without such columns."""
    there = {kind: [n + suffix for n in kind] for kind in (QUATERNION, VECTOR, ANGLES)}
    kinds = [kind for kind, names in there.items() if any(name in table.names for name in names)]
    if not kinds:
        return None
    if len(kinds) > 1:
        raise table.error(
            f"columns {there[kinds[0]][0]} and {there[kinds[1]][0]} give orientations twice; keep one kind"
        )
    names = there[kinds[0]]
    if missing := [name for name in names if name not in table.names]:
        raise table.error(f"column {missing[0]} is missing; an orientation must be given as {', '.join(names)}")
    values = table.numbers(names)
    good = np.isfinite(values).all(axis=1)
    turn = np.full((len(values), 3), np.nan)
    if kinds[0] is QUATERNION:
        length = np.linalg.norm(values[good], axis=1)
        if (np.abs(length - 1.0) > 0.01).any():
            line = table.line(int(np.flatnonzero(good)[np.abs(length - 1.0) > 0.01][0]))
            raise table.error(f"line {line}: {', '.join(names)}: is no unit quaternion; its length must be 1")
        turn[good] = Rotation.from_quat(values[good][:, [1, 2, 3, 0]]).as_rotvec() if good.any() else 0.0
        return turn
    _check_unit(table, ", ".join(names), values, 2.0 * np.pi + 0.1, "rad", "degrees")
    if good.any():
        vector = kinds[0] is VECTOR
        turns = Rotation.from_rotvec(values[good]) if vector else Rotation.from_euler("xyz", values[good])
        turn[good] = turns.as_rotvec()
    return turn


def _by_name(table: Cells, q: Array, seen: _Seen) -> tuple[list[_Seen], Index]:
    """The reflectors of a table with a column ``reflector``, over its poses, and the first row of each pose.

    Neighbouring rows with equal angles are one pose, unless they name the same reflector twice.
    """
    names = table.texts("reflector")
    if "" in names:
        raise table.error(
            f"line {table.line(names.index(''))}: reflector: is empty; must name the reflector of the row"
        )
    first: list[int] = []
    pose, there = np.zeros(len(q), int), set[str]()
    for row, name in enumerate(names):
        same = row > 0 and np.array_equal(q[row], q[row - 1], equal_nan=True) and name not in there
        if not same:
            first.append(row)
            there = set()
        there.add(name)
        pose[row] = len(first) - 1
    places = table.numbers(list(PLACE)) if all(name in table.names for name in PLACE) else np.zeros((len(q), 0))
    found = []
    for name in dict.fromkeys(names):
        of_reflector = np.flatnonzero(np.array(names) == name)
        xyz, turn = np.full((len(first), 3), np.nan), None
        xyz[pose[of_reflector]] = seen.xyz[of_reflector]
        if seen.turn is not None and np.isfinite(seen.turn[of_reflector]).any():
            turn = np.full((len(first), 3), np.nan)
            turn[pose[of_reflector]] = seen.turn[of_reflector]
        given = places[of_reflector]
        place = _one_place(table, given[np.isfinite(given).all(axis=1)]) if given.shape[1] else None
        found.append(_Seen(name, xyz, turn, place))
    return found, np.array(first, int)


def _check_unit(table: Cells, name: str, values: Array, largest: float, unit: str, other: str) -> None:
    high = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
    if high > largest:
        example = f"{name.split(',')[0]} [{'deg' if unit == 'rad' else other}]"
        raise table.error(f"{name}: {high:.4g} is no value in {unit}; must be in {unit}, not in {other}, or the "
                          f"columns must name their unit, as in {example}")  # fmt: skip
