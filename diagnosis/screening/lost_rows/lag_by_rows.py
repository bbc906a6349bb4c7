"""The lag of the currents in whole rows, row by row of a run: several losses of one recording, long and short.

What is expected is compared with the currents some rows earlier, for every number of rows. Dynamic programming finds
the path of lags that explains all rows and joints best, at a price for every change (as in ``lag_path``). A device that
drops triggers drops them again, so that lags only grow, or only fall. Rows count as certain as they are
(``Run.deviation``): where friction turns abruptly, a model that has it not quite right would choose lags of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_change import COLOURED, FILTERED, mean_time
from diagnosis.screening.lost_rows.lag_path import Step
from diagnosis.screening.lost_rows.unmeasured_rows import SMEARED

Index = NDArray[np.intp]

LONGEST = 0.06
"""s: most that is looked for about each of the given lags ..."""
MOST = 40
"""... and rows, where these are more."""
PRICE = 25.0
"""Fall of the normalised squared error that a change must bring: five std. Joints must agree on it besides."""
OTHERS = 16.0
"""Part of that fall which the joints other than the one that shows it best must bring: four std."""
BEFORE = 4.0
"""Fall that the part before a change must show at those joints for its own lag: a joint that is wrong in another way
chooses any lag while the others rest."""
WORSE = 0.1
"""Of that part, how much worse one joint may become: rows lost by a device shift all its currents alike."""
SHORT = 0.25
"""s of a part that is none."""
UNSURE = 0.5
"""Rows: largest std of a small change ..."""
SHARE = 0.1
"""... and share of a great one."""
OFF = 1.0
"""Rows by which what the parts on either side show may differ from a change, or twice the std of that: of parts with
one lag each no more is possible. Whether it is a whole number is judged with the currents put back (``lost_triggers``).
"""


@dataclass(frozen=True)
class RowStep(Step):
    """With its standard deviations, s."""

    time_std: float
    step_std: float


@dataclass(frozen=True)
class _Path:
    """Normalised squared errors (r, K, n) of the rows by each of ``lags`` (K,) rows, and the path of lags: parts.

    edges: first row of every part, and the end; of_part: index of its lag; period: s of a row of a lag.
    """

    t: Array
    lags: Index
    errors: Array
    edges: list[int]
    of_part: list[int]
    period: float

    def fall(self, part: int, other: int) -> Array:
        """(n,) by how much the lag of a part explains its rows better than that of another part."""
        return self.fall_to(part, self.of_part[other])

    def fall_to(self, part: int, lag: int) -> Array:
        """(n,) by how much the lag of a part explains its rows better than another (its index)."""
        rows = self.errors[self.measured(part)]
        return np.asarray(np.sum(rows[:, lag] - rows[:, self.of_part[part]], axis=0))

    def measured(self, part: int) -> slice:
        """Rows of a part, without those that are missing at its beginning, and what filters smear of them."""
        first, end = self.edges[part], self.edges[part + 1]
        smeared = round(SMEARED / (self.t[1] - self.t[0]))
        missing = self.missing(part) + smeared if part else 0
        inner = slice(min(first + missing, end - 1), max(end - smeared, first + 1))
        return inner if inner.stop > inner.start else slice(first, end)

    def inside(self) -> bool:
        """Whether lags of a row less and of a row more were compared beside the lag of every part."""
        known = set(self.lags.tolist())
        return all({lag - 1, lag + 1} <= known for lag in self.lags[self.of_part].tolist())

    def moved(self, part: int, rows: int) -> int:
        """Index of the lag of a part, more by so many rows: the nearest of those that are compared."""
        return int(np.argmin(np.abs(self.lags - self.lags[self.of_part[part]] - rows)))

    def step(self, change: int) -> int:
        """Rows by which the lag grows at the change before part ``change``."""
        return int(self.lags[self.of_part[change]] - self.lags[self.of_part[change - 1]])

    def length(self, part: int) -> float:
        """s from the first row of a part to the first of the next."""
        return float(self.t[self.edges[part + 1]] - self.t[self.edges[part]])

    def vertex(self, part: int) -> tuple[float, float]:
        """Rows beyond the lag of a part, at which parabolas through the errors of three lags are lowest; its std.

        The std includes by how much joints contradict each other: they move at different times, and what is shorter
        than can be found may lie between.
        """
        k = self.of_part[part]
        below, here, above = self.errors[self.measured(part), k - 1 : k + 2].sum(axis=0)
        bend = (below + above - 2.0 * here) / 2.0
        size = float(np.sum(bend))
        if size <= 0.0:
            return 0.0, np.inf
        of_each = np.where(bend > 0.0, (below - above) / (4.0 * np.where(bend > 0.0, bend, 1.0)), 0.0)
        weight = np.maximum(bend, 0.0)
        offset = float(np.sum((below - above) / 4.0)) / size
        disagreement = float(np.sum(weight * (of_each - offset) ** 2)) / max(len(weight) - 1, 1)
        return offset, float(np.sqrt(max(disagreement, 1.0) / size))

    def joined(self, change: int, part: int) -> _Path:
        """The path without the change before part ``change``: the parts on either side have the lag of ``part``."""
        of_part = [*self.of_part[: change - 1], self.of_part[part], *self.of_part[change + 1 :]]
        edges = [*self.edges[:change], *self.edges[change + 1 :]]
        return replace(self, edges=edges, of_part=of_part)

    def edged(self, change: int) -> _Path:
        """The same with the change before part ``change`` where both lags explain their rows best."""
        edge = self.edges[change - 1] + 1 + int(np.argmax(self.likelihood(change)[1:-1]))
        return replace(self, edges=[*self.edges[:change], edge, *self.edges[change + 1 :]])

    def likelihood(self, change: int) -> Array:
        """(k,) log of the likelihood of every row, between the changes beside it, as the first after a change.

        Rows that are missing after it are not counted.
        """
        rows = self.errors[self.edges[change - 1] : self.edges[change + 1]].sum(axis=2)
        lags = self.of_part[change - 1], self.of_part[change]
        before, after = (np.cumsum(np.append(0.0, rows[:, lag])) for lag in lags)
        behind = np.minimum(np.arange(len(before) - 1) + self.missing(change), len(before) - 1)
        return np.asarray(-(before[:-1] + after[-1] - after[behind]) / 2.0)

    def missing(self, change: int) -> int:
        """Rows of the run that are missing after a change: those of a lag that grows."""
        return round(max(self.step(change), 0) * self.period / (self.t[1] - self.t[0]))


def steps_by_rows(run: Run, period: float, about: Sequence[float] = (0.0,)) -> list[RowStep]:
    """The changes of a run's lag by whole rows, in time; ``period`` s between the rows of its recording.

    about: s, lags near which it is looked for. What all rows have in common (time skew) is no change.
    """
    if len(run.t) < 2:
        return []
    skew = 0.0
    for _ in range(2):  # what rows have in common is known to a part of a row once the changes are
        path = _path(run, period, about, skew)
        if len(path.of_part) < 2 or not path.inside():
            return []
        offsets, stds = np.array([path.vertex(part) for part in range(len(path.of_part))]).T
        weight = np.minimum(stds**-2, 1e12)
        skew += period * float(np.sum(weight * offsets) / max(float(np.sum(weight)), 1e-300))
    path = _of_long_parts(path)
    while refuted := [k for k in range(1, len(path.of_part)) if not _shown(path, k)]:
        k = min(refuted, key=lambda one: path.fall(one, one - 1).sum())
        path = path.joined(k, k - 1 if path.fall(k - 1, k).sum() > path.fall(k, k - 1).sum() else k)
    return [_step(path, k) for k in range(1, len(path.of_part))]


def _of_long_parts(path: _Path) -> _Path:
    """The path without its short parts: filters smear a change, and rows are missing, so that other lags follow it."""
    while short := [k for k in range(1, len(path.of_part) - 1) if path.length(k) < SHORT]:
        k = min(short, key=path.length)
        nearer = path.fall(k, k - 1).sum() < path.fall(k, k + 1).sum()
        path = (path.joined(k, k - 1) if nearer else path.joined(k + 1, k + 1)).edged(k)
    return path


def _path(run: Run, period: float, about: Sequence[float], skew: float) -> _Path:
    """The cheapest path of lags that only grow, or only fall."""
    side = max(int(np.ceil(LONGEST / period)), MOST)
    longest = int(0.25 * (run.t[-1] - run.t[0]) / period)
    near = np.concatenate([round(lag / period) + np.arange(-side, side + 1) for lag in about])
    lags = np.unique(near[np.abs(near) <= longest])
    current = CubicSpline(run.t, run.current)
    taken = (np.clip(run.t - skew - lag * period, run.t[0], run.t[-1]) for lag in lags.tolist())
    errors = np.stack([((current(at) - run.expected) / run.deviation) ** 2 for at in taken], axis=1)
    scatter = errors.mean(axis=0).min(axis=0)
    for _ in range(2):  # the scatter of each joint is known once the path is
        cost = (errors / np.maximum(COLOURED * scatter, 1e-300)).sum(axis=2)
        path = min((_monotone(cost), _monotone(cost[:, ::-1], reverse=True)), key=lambda one: one[1])[0]
        scatter = errors[np.arange(len(path)), path].mean(axis=0)
    edges = [0, *(np.flatnonzero(np.diff(path)) + 1).tolist(), len(path)]
    normalised = errors / np.maximum(COLOURED * scatter, 1e-300)
    return _Path(run.t, lags, normalised, edges, [int(path[first]) for first in edges[:-1]], period)


def _monotone(cost: Array, *, reverse: bool = False) -> tuple[Index, float]:
    """(r,) index of the lag of every row, which never falls, so that costs (r, K) and changes are least; its cost."""
    count = cost.shape[1]
    stay, best = np.arange(count), cost[0].copy()
    came_from = np.empty(cost.shape, dtype=np.intp)
    for row in range(1, len(cost)):
        least = np.minimum.accumulate(best)
        lower = np.maximum.accumulate(np.where(best <= least, stay, 0))
        came_from[row] = np.where(best <= least + PRICE, stay, lower)
        best = np.minimum(best, least + PRICE) + cost[row]
    path = np.empty(len(cost), dtype=np.intp)
    path[-1] = int(np.argmin(best))
    for row in range(len(cost) - 1, 0, -1):
        path[row - 1] = came_from[row, path[row]]
    return (count - 1 - path if reverse else path), float(best.min())


def _shown(path: _Path, k: int) -> bool:
    """Whether the joints agree on the change before part ``k``.

    Where only one joint moves after it, this one must show it on both sides, beside a change that several show: what
    has lost rows loses them again.
    """
    before, after = _falls(path, k)
    several = _of_others(after) > OTHERS
    again = any(_of_others(_falls(path, other)[1]) > OTHERS for other in range(1, len(path.of_part)) if other != k)
    alone = int(np.argmax(after))
    if not (several or (again and min(before[alone], after[alone]) > PRICE)):
        return False
    if float(after.min()) < -WORSE * float(after.sum()) or _of_others(before) < BEFORE:
        return False
    misfit, std = _misfit(path, k)
    return std < max(UNSURE, SHARE * abs(path.step(k))) and abs(misfit) < max(OFF, 2.0 * std)


def _falls(path: _Path, k: int) -> tuple[Array, Array]:
    """(n,) each: by how much worse the parts before change ``k``, and those after it, are without it.

    Lags were then greater by the change in all parts before it, or less in all after it.
    """
    sides = (range(k), path.step(k)), (range(k, len(path.of_part)), -path.step(k))
    before, after = (
        sum((path.fall_to(part, path.moved(part, by)) for part in parts), np.zeros(path.errors.shape[2]))
        for parts, by in sides
    )
    return before, after


def _of_others(fall: Array) -> float:
    """Sum of what joints (n,) gain, without the joint that gains most."""
    return float(np.sum(fall) - fall.max())


def _misfit(path: _Path, k: int) -> tuple[float, float]:
    """Rows by which what both parts show differs from the change before part ``k``, and the std of that."""
    (before, before_std), (after, after_std) = path.vertex(k - 1), path.vertex(k)
    return after - before, float(np.hypot(before_std, after_std))


def _step(path: _Path, k: int) -> RowStep:
    """The change before part ``k``: its instant is the mean of all between its neighbours, by likelihood."""
    time, variance = mean_time(path.t[path.edges[k - 1] : path.edges[k + 1]], path.likelihood(k))
    before = float(path.lags[path.of_part[k - 1]]) * path.period
    misfit, std = _misfit(path, k)
    step = (path.step(k) + misfit) * path.period
    return RowStep(time - before, step, float(np.hypot(np.sqrt(variance), FILTERED)), std * path.period)
