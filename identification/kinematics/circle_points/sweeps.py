"""Single-joint sweeps in a recording: the stretches in which one joint alone travels far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.circle_points.circle_point import LEAST_ARC, Circle, DegenerateSweep, fit_circle

_STILL = 4e-4
"""rad: over a window, an arm of which no joint moves more than this stands."""
ALONE = 0.1
"""A joint moves alone while every other moves less than this share of its travel: servos give way a little."""


@dataclass(frozen=True)
class Sweep:
    """Rows first..last (exclusive) of a recording in which ``joint`` (from 1) moves alone, over ``travel`` rad."""

    joint: int
    first: int
    last: int
    travel: float


def find_sweeps(q: Array, *, window: int = 50) -> list[Sweep]:
    """Sweeps of a recording q (N, joints) rad, in time order; only those that go far enough for a circle.

    Rows are cut into windows; each is given to the joint that alone moves in it, and equal neighbours are joined. A
    window in which nothing moves belongs to the sweep around it.
    """
    n = len(q)
    owner = []
    for first in range(0, n, window):
        part = q[first : first + window]
        travel = np.nan_to_num(np.fmax.reduce(part) - np.fmin.reduce(part))
        j = int(np.argmax(travel))
        alone = np.delete(travel, j).max(initial=0.0) < ALONE * travel[j]
        owner.append(0 if travel[j] < _STILL else j + 1 if alone else -1)
    sweeps: list[Sweep] = []
    start, current = 0, 0
    for k, joint in enumerate([*owner, -1]):
        if joint == current or joint == 0:
            continue
        if current > 0:
            sweeps.append(_sweep(q, current, start * window, min(k * window, n)))
        current, start = joint, k
    return [s for s in sweeps if s.travel >= LEAST_ARC]


def _sweep(q: Array, joint: int, first: int, last: int) -> Sweep:
    return Sweep(joint, first, last, float(np.nanmax(q[first:last, joint - 1]) - np.nanmin(q[first:last, joint - 1])))


def circles_of(q: Array, xyz: Array, *, window: int = 50) -> tuple[list[Circle], list[str]]:
    """The best circle of every joint that was swept, last joint first, and the reasons why others were refused.

    window: rows, as in ``find_sweeps``; 2 where every row is a pose at rest.
    """
    circles: dict[int, Circle] = {}
    refused = []
    for sweep in find_sweeps(q, window=window):
        rows = slice(sweep.first, sweep.last)
        try:
            circle = fit_circle(q[rows], xyz[rows], sweep.joint)
        except DegenerateSweep as reason:
            refused.append(str(reason))
            continue
        best = circles.get(sweep.joint)
        if best is None or circle.std_centre < best.std_centre:
            circles[sweep.joint] = circle
    return [circles[j] for j in sorted(circles, reverse=True)], refused
