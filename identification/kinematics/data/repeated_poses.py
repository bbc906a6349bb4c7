"""Whether held-out poses are new: rows of a table or recording that another one holds too, and poses taken again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from arm_io import InputError
from arm_io.types import Array
from daq.recording.shared_rows import overlaps_of, row_keys
from identification.kinematics.data.runs import Run

SHARE = 0.01
"""Of the poses of a table: more of them, and more than one, that were measured with the same result are copies."""
COARSE = 1e-5
"""m: points that are all whole multiples of it come out the same where a pose is measured anew."""
COUNT = 1e-4
"""rad, m: joints that are nearer are at one pose; counts of geared arms are 1e-6 to 1e-4 rad."""


@dataclass(frozen=True, eq=False)
class Poses:
    """The contents of a file: q (n, J) rad or m, xyz (n, 3) m; ``still``: each row is a pose at rest.

    With several reflectors, the rows of the second follow all rows of the first.
    """

    path: Path
    q: Array
    xyz: Array
    still: bool

    @staticmethod
    def of(path: Path, runs: Sequence[Run]) -> Poses:
        """The positions of all targets of a table."""
        places = [run for run in runs if not run.lever]
        q, xyz = (np.concatenate([getattr(run, name) for run in places]) for name in ("q", "xyz"))
        return Poses(path, q, xyz, places[0].still)

    def with_points(self) -> Poses:
        """The rows with angles and a point."""
        rows = np.isfinite(self.q).all(axis=1) & np.isfinite(self.xyz).all(axis=1)
        return Poses(self.path, self.q[rows], self.xyz[rows], self.still)


def check_new(fitted: Sequence[Poses], held_out: Sequence[Poses]) -> list[str]:
    """Warnings of held-out poses that were fitted, too, and measured anew.

    InputError where measured rows of one file are in another one: those judge nothing, or count twice.
    """
    every = [one.with_points() for one in [*fitted, *held_out]]
    for number, other in enumerate(every):
        for before, one in enumerate(every[:number]):
            if rows := _in_common(one, other):
                both = number >= len(fitted) > before
                fault = "is both fitted and held out" if both else "is given twice"
                right = "held-out poses must be measured anew" if both else "give each measurement once"
                rows_of = f"{rows} of its {len(other.q)} rows are in {one.path}, angles and points"
                raise InputError(other.path, f"{fault}: {rows_of}; {right}")
    return _again(every[: len(fitted)], every[len(fitted) :])


def _in_common(one: Poses, other: Poses) -> int:
    """Rows of ``other`` that ``one`` has; 0 where chance explains them."""
    if one.q.shape[1] != other.q.shape[1] or not len(one.q) or not len(other.q):
        return 0
    keys = [row_keys(side.q, side.xyz) for side in (one, other)]
    same = np.isin(np.unique(keys[1]), keys[0])
    rows = int(np.isin(keys[1], keys[0]).sum())
    if overlaps_of(keys):
        return rows
    if not (one.still or other.still) or _coarse(other.xyz):
        return 0
    return rows if same.sum() > max(1.0, SHARE * len(same)) else 0


def _coarse(xyz: Array) -> bool:
    steps = xyz / COARSE
    return bool(np.all(np.abs(steps - np.rint(steps)) < 1e-3))


def _again(fitted: Sequence[Poses], held_out: Sequence[Poses]) -> list[str]:
    """A warning for each file with held-out poses at which fitted ones were measured."""
    known = [one.q for one in fitted if len(one.q)]
    if not known:
        return []
    tree, found = cKDTree(np.concatenate(known)), []
    for one in held_out:
        _, first = np.unique(np.rint(one.q / COUNT), axis=0, return_index=True)
        poses = one.q[first]
        near = np.isfinite(tree.query(poses, p=np.inf, distance_upper_bound=COUNT)[0]) if len(poses) else np.zeros(0)
        if near.sum() > SHARE * len(poses):
            found.append(
                f"{one.path.name}: {int(near.sum())} of {len(poses)} held-out poses have the joint angles of fitted "
                f"ones (within {COUNT:g} rad or m); these judge the noise, not the model between the poses"
            )
    return found
