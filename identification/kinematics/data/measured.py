"""What a calibration is fitted to and judged by: runs of link angles and points, as corrected so far."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.data.row_shifts import Shift
from identification.kinematics.data.runs import Run, points_of, thinned
from identification.kinematics.models.chain import Index

MOST = 10000
"""Points used for fitting; more are evenly thinned: neighbours at 1 kHz say the same thing."""
JudgedBy = Literal["held_out", "split", "cross-validation"]


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Fitted and held-out runs.

    judged_by  "split": ``held_out`` are blocks of the same runs; "cross-validation": they are the same runs
    coupling   (n, n): link angles = coupling times reported ones
    aims       (3, 3) by target: the frame that its measured orientations are of now, in which they were given
    shifts     rows that belonged to another trigger, and were moved back
    warnings   on the choice of what judges
    """

    runs: tuple[Run, ...]
    held_out: tuple[Run, ...]
    judged_by: JudgedBy
    coupling: Array
    aims: Mapping[int, Array] = field(default_factory=dict)
    shifts: tuple[Shift, ...] = ()
    warnings: tuple[str, ...] = ()

    @cached_property
    def rows(self) -> list[Index]:
        """The usable rows of every fitted run, evenly thinned."""
        return thinned(self.runs, MOST)

    @cached_property
    def points(self) -> Points:
        """The points of ``rows``, run after run."""
        return points_of(self.runs, self.rows)

    def each(self, change: Callable[[Run], Run]) -> Measured:
        """The same with every run, fitted or held out, changed."""
        return replace(self, runs=tuple(map(change, self.runs)), held_out=tuple(map(change, self.held_out)))

    def linked(self, matrix: Array) -> Measured:
        """The same with link angles that are matrix (n, n) times what they were."""
        return replace(self.each(lambda run: linked(run, matrix)), coupling=matrix @ self.coupling)


def linked(run: Run, matrix: Array) -> Run:
    """The run with joint angles matrix (n, n) times its own, and its encoders' counts as large as they then are."""
    count = None if run.count is None else np.abs(matrix) @ run.count
    return replace(run, q=run.q @ matrix.T, count=count)


def ends_of(rows: Sequence[Index]) -> Index:
    """(runs + 1,) where the points of each run begin among those of all ``rows``, and where the last end."""
    return np.cumsum([0, *map(len, rows)])
