"""Rows that belong to another trigger: a delay between points and joint angles, constant or changing in a run.

The point moves with velocity v = J(q) q'. If it is recorded ``delay`` too late, the residual is -v delay; so in every
window with enough motion, delay = -sum(v . r) / sum(v . v). A dropped edge makes all later rows one early or late: a
step in the delay of a whole row (effects ``dropped_trigger`` and ``tracker_latency``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.runs import Run, shifted
from identification.kinematics.models.chain import Chain, position, position_jacobian
from identification.selection import MAD_TO_STD

_WINDOWS = 80
"""Windows of a run, in each of which one delay is estimated."""
_LEAST_STEP = 0.6
"""Rows: a smaller step is nearer to none than to a whole row."""
_LEAST_Z = 8.0
"""Standard deviations that a step must exceed: it is the largest of all places."""
_MOST_ROWS = 3
"""Rows of a constant delay: a longer one is of the tracker."""
_OFF_WHOLE = 0.2
"""Rows by which a constant delay may miss a whole number."""
_LEAST_CERTAIN = 0.1
"""Rows: largest std of such a delay."""
_BETTER = 0.75
"""Share of the median distance of the points that a shift may leave: errors of the model are not as large."""
_BLOCK = 10_000
"""Rows of a Jacobian at a time."""


@dataclass(frozen=True)
class Shift:
    """Points from row ``first`` of run ``name`` on belong ``rows`` rows earlier (positive: they were recorded late)."""

    run: str
    first: int
    rows: int
    delay: float  # rows, as measured
    std: float

    def __str__(self) -> str:
        place = "all points" if self.first == 0 else f"points from row {self.first} on"
        sense = "late" if self.rows > 0 else "early"
        return (
            f"{self.run}: {place} are {abs(self.rows)} row(s) {sense} against the joints "
            f"({self.delay:+.2f} +- {self.std:.2f} rows); realigned"
        )


@dataclass(frozen=True)
class Delays:
    """Delay of the points in windows: first row of each (windows,), delay in rows and its standard deviation."""

    first: Array
    delay: Array
    std: Array


def delays(run: Run, chain: Chain, noise: float) -> Delays:
    """Delays over a run for a chain that is about right, with tracker noise of ``noise`` m a coordinate.

    ``run.q`` are the joint angles of the chain, with everything else that turns the joints (sag ...) included.
    """
    good = run.usable.copy()
    at, velocity = _moving(run, chain)
    residual = run.xyz - at
    length = np.linalg.norm(np.nan_to_num(residual), axis=1)
    size = max(5, len(run.t) // _WINDOWS)
    first, delay, std = [], [], []
    for start in range(0, len(run.t), size):
        rows = np.flatnonzero(good[start : start + size]) + start
        # A wrong point is far from its neighbours; late ones are all displaced together, and are what is searched for.
        rows = rows[length[rows] < 4.0 * float(np.median(length[rows])) + 3.0 * noise] if len(rows) else rows
        if len(rows) < 3:
            continue
        v, r = velocity[rows], residual[rows]
        power = float(np.sum(v * v))
        if np.sqrt(power) < 10.0 * noise:  # ten times better than a row, or the window does not determine the delay
            continue
        first.append(start)
        delay.append(-float(np.sum(v * r)) / power)
        std.append(noise / np.sqrt(power))
    return Delays(np.array(first), np.array(delay), np.array(std))


def _moving(run: Run, chain: Chain) -> tuple[Array, Array]:
    """Positions (N, 3) m of the run's target by the chain, and their change per row (N, 3) m.

    Computed in blocks, because a Jacobian has a hundred times as many numbers as a row.
    """
    at, velocity = np.empty_like(run.xyz), np.empty_like(run.xyz)
    rate, steps = run.velocity() * run.period, chain.joint_steps()
    for first in range(0, len(run.t), _BLOCK):
        rows = slice(first, first + _BLOCK)
        q = np.nan_to_num(run.q[rows])
        at[rows], derivative = position_jacobian(chain, q, np.full(len(q), run.target))
        velocity[rows] = np.einsum("nij,nj->ni", derivative[:, :, steps], rate[rows])
    return at, velocity


def find_step(run: Run, chain: Chain, noise: float) -> Shift | None:
    """The largest step of the delay by a whole number of rows within a run, or None."""
    measured = delays(run, chain, noise)
    if len(measured.first) < 6:
        return None
    scatter = max(float(np.median(np.abs(np.diff(measured.delay)))), float(np.median(measured.std)), 1e-6)
    best: tuple[float, int, float] | None = None
    for k in range(2, len(measured.first) - 1):
        before, after = measured.delay[:k], measured.delay[k:]
        step = float(np.median(after) - np.median(before))
        z = abs(step) / (scatter * np.sqrt(1.0 / len(before) + 1.0 / len(after)))
        if best is None or z > best[0]:
            best = (z, k, step)
    if best is None or best[0] < _LEAST_Z or abs(best[2]) < _LEAST_STEP:
        return None
    z, k, step = best
    if round(step) == 0:
        return None
    row = _refine(
        run,
        chain,
        int(measured.first[max(k - 6, 0)]),
        int(measured.first[min(k + 5, len(measured.first) - 1)]),
        round(step),
    )
    return _if_better(run, chain, Shift(run.name, row, round(step), step, abs(step) / z))


def find_constant(run: Run, chain: Chain, noise: float) -> Shift | None:
    """A delay of all points of a run by one to three whole rows, or None.

    A delay that is not a whole number of rows is left to the latency of the tracker.
    """
    measured = delays(run, chain, noise)
    if len(measured.first) < 3:
        return None
    delay = float(np.median(measured.delay))
    std = MAD_TO_STD * float(np.median(np.abs(measured.delay - delay))) / np.sqrt(len(measured.delay))
    rows = round(delay)
    if not 1 <= abs(rows) <= _MOST_ROWS or abs(delay - rows) > _OFF_WHOLE or std > _LEAST_CERTAIN:
        return None
    return _if_better(run, chain, Shift(run.name, 0, rows, delay, std))


def _if_better(run: Run, chain: Chain, shift: Shift) -> Shift | None:
    """The shift, if with it the points fit better while the arm moves, by more than errors of the model; else None."""
    moving = np.abs(run.velocity()).max(axis=1) > 0.0
    moving[: shift.first] = False
    at = _moving(run, chain)[0]
    as_is = np.linalg.norm(run.xyz - at, axis=1)[moving]
    moved = np.linalg.norm(shifted(run, shift.first, shift.rows).xyz - at, axis=1)[moving]
    both = np.isfinite(as_is) & np.isfinite(moved)
    if not both.any() or np.median(moved[both]) > _BETTER * np.median(as_is[both]):
        return None
    return shift


def _refine(run: Run, chain: Chain, low: int, high: int, rows: int) -> int:
    """The row between two windows from which on points shifted back by ``rows`` fit better than as they are."""
    low, high = max(low, 0), min(high + max(1, len(run.t) // _WINDOWS), len(run.t))
    q = np.nan_to_num(run.q[low:high])
    at = position(chain, q, np.full(len(q), run.target))
    source = np.arange(low, high) + rows
    inside = (source >= 0) & (source < len(run.t))
    as_is = np.nan_to_num(np.linalg.norm(run.xyz[low:high] - at, axis=1))
    moved = np.where(
        inside, np.nan_to_num(np.linalg.norm(run.xyz[np.clip(source, 0, len(run.t) - 1)] - at, axis=1)), 0.0
    )
    gain = np.clip(as_is - moved, -1e-3, 1e-3)  # a wrong point must not decide
    later = np.cumsum(gain[::-1])[::-1]
    return low + int(np.argmax(later))
