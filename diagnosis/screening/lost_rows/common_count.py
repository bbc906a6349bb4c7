"""The same number of rows lost in several recordings, judged by all of them together.

Of one recording whose joints move one after the other, or hardly, no change of lag is certain. A device that drops
triggers drops them in every recording alike: the likelihoods of a whole number of rows, each at an instant of its own,
are multiplied over the recordings (as of a change point with an unknown place: Hinkley, "Inference about the
change-point in a sequence of random variables", Biometrika 57, 1970).

Currents are compared with the rows put back. The first-order effect of a lag of some milliseconds on the residual is
another one where friction turns round, so that joints seem to contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_change import COLOURED, FILTERED, mean_time

Index = NDArray[np.intp]

LONGEST = 0.02
"""s: longest change that is looked for here, as far as the path of lags (``lag_path``) does not show it ..."""
MOST = 24
"""... and its most rows."""
LONGEST_SKEW = 0.012
"""s: longest time skew that all recordings may have besides a loss; without one, longer ones count as well."""
SKEWS = 0.002
"""s between the skews that are tried; about them, the lag of each joint is free."""
SURE = 24.5
"""Evidence for the number in all recordings: seven std."""
OTHERS = 8.0
"""Evidence for the number in the joints without any one of them: four std."""
ODDS = 3.0
"""Evidence by which one recording has lost rows, or by which some joints contradict a number: 20 to 1."""
WHOLE = 0.3
"""Rows by which the change that fits best may miss the whole number; its std where that is more: at a high rate a row
is less than what a lag is known to, and what tells lost rows from other errors is how surely all joints changed."""
PLACED = 1.0
"""s: largest std of an instant that counts; an error that grows slowly has none."""
RECORDINGS = 2
"""Recordings, at least, that must have lost rows."""
APART = 0.04
"""s between the instants that are compared, more where a recording would have more than ``INSTANTS``."""
INSTANTS = 500
"""Instants of a recording that are compared, at most."""
FEWEST = 4
"""Rows of the shortest run that is interpolated."""


@dataclass(frozen=True)
class CommonCount:
    """``count`` (std ``count_std``) rows that currents belong to later, and since when: time and its std, s.

    instants: of each recording, by its index, that lost rows.
    """

    count: int
    count_std: float
    instants: dict[int, tuple[float, float]]


@dataclass(frozen=True)
class _Losses:
    """Squared residuals over their std of a recording, with every loss put back and each joint's lag free.

    t       (m,) s: instants of a loss
    errors  (skews, counts, m, n)
    none    (lags, n) without a loss, by every skew that is compared, with and without a loss
    scatter (n,) mean square of what the best loss leaves, times the rows over which it is correlated
    """

    t: Array
    errors: Array
    none: Array
    scatter: Array

    def falls(self, joints: Array) -> Array:
        """(skews, counts, m) fall of twice the log of the likelihood by a loss; ``joints`` (n,) 1 or 0 to leave out."""
        weight = joints / self.scatter
        return np.asarray((self.none @ weight).min() - self.errors @ weight)


def common_count(runs: Sequence[Run], periods: Sequence[float], shown: int = 0) -> CommonCount | None:
    """The number of rows that several recordings lost alike; None where they do not show one.

    shown: the most rows that one of them shows by itself, which others may have lost as well.
    """
    longest = min(max(int(LONGEST / max(periods, default=np.inf)), shown + 1), MOST)
    if len(runs) < RECORDINGS or longest == 0 or not all(len(run.t) >= FEWEST for run in runs):
        return None
    step = max(1, round(SKEWS / max(periods)))
    side = int(LONGEST_SKEW / max(periods)) // step
    skews, counts = step * np.arange(-side, side + 1), np.arange(-longest - 1, longest + 2)
    losses = [_losses(run, period, skews, counts) for run, period in zip(runs, periods)]
    joints = np.ones(runs[0].current.shape[1])
    evidence = _evidence(losses, joints)
    total = _together(evidence)
    best = int(np.argmax(total.max(axis=0)))
    skew, count = int(np.argmax(total[:, best])), int(counts[best])
    of_each = evidence[:, skew, best]
    if total[skew, best] < SURE or count == 0 or not 0 < best < len(counts) - 1:
        return None
    rows, std = _vertex(count, total.max(axis=0)[best - 1 : best + 2])
    if abs(rows - count) > max(WHOLE, std) or any(_contradicted(losses, one, best) for one in 1.0 - np.diag(joints)):
        return None
    instants = {k: _instant(of_one, skew, best) for k, of_one in enumerate(losses) if of_each[k] > ODDS}
    placed = [k for k, (_, time_std) in instants.items() if time_std < PLACED]
    if len(placed) < RECORDINGS or float(np.sum(of_each[placed])) < SURE:
        return None
    return CommonCount(count, max(std, abs(rows - count), 0.05), instants)


def _losses(run: Run, period: float, skews: Index, counts: Index) -> _Losses:
    edges = np.arange(0, len(run.t), max(1, round(APART * run.per_second), len(run.t) // INSTANTS))
    longest = int(skews.max() + counts.max())
    before = _before(run, period, edges, longest)
    total = before[:, :, -1:]
    # currents at the skew up to the instant, and put back by so many rows more after it
    later = skews[:, None] + counts
    square, product, size = before[:, skews + longest][:, :, None] + (total - before)[:, later + longest]
    errors = square - product**2 / np.maximum(size, 1e-300)
    square, product, size = total[:, :, 0]
    none = square - product**2 / np.maximum(size, 1e-300)
    by_loss = errors.reshape(-1, len(run.current.T))
    smallest = by_loss[np.argmin(by_loss @ (1.0 / np.maximum(none.min(axis=0), 1e-300)))]
    scatter = np.maximum(COLOURED * smallest / len(run.t), 1e-12)
    return _Losses(np.append(run.t[edges], run.t[-1]), errors, none, scatter)


def _before(run: Run, period: float, edges: Index, longest: int) -> Array:
    """(3, lags, m, n) sums over the rows before each instant, and over all, with currents put back by every lag.

    Of the squared residual, of its product with the current's rate, and of the squared rate, all over the std.
    """
    current, rate = (CubicSpline(run.t, values) for values in (run.current, run.current_rate))
    sums = np.zeros((3, 2 * longest + 1, len(edges) + 1, run.current.shape[1]))
    for k in range(2 * longest + 1):
        at = np.clip(run.t - (k - longest) * period, run.t[0], run.t[-1])
        residual, slope = (current(at) - run.expected) / run.deviation, rate(at) / run.deviation
        for partial, values in zip(sums, (residual**2, residual * slope, slope**2)):
            partial[k, 1:] = np.cumsum(np.add.reduceat(values, edges), axis=0)
    return sums


def _evidence(losses: Sequence[_Losses], joints: Array) -> Array:
    """(recordings, skews, counts) log of the likelihood of each loss, at any instant alike, over that of no loss."""
    evidence = []
    for of_recording in losses:
        falls = of_recording.falls(joints) / 2.0
        highest = falls.max(axis=2)
        evidence.append(highest + np.log(np.mean(np.exp(falls - highest[..., None]), axis=2)))
    return np.stack(evidence)


def _together(evidence: Array) -> Array:
    """(skews, counts) evidence of all recordings; each lost rows or did not, at even odds."""
    return np.asarray(np.sum(np.logaddexp(0.0, evidence) - np.log(2.0), axis=0))


def _contradicted(losses: Sequence[_Losses], joints: Array, best: int) -> bool:
    """Whether these joints show too little of a count, or another one that is far likelier."""
    total = _together(_evidence(losses, joints)).max(axis=0)
    return bool(total[best] < max(OTHERS, total.max() - ODDS))


def _vertex(count: int, total: Array) -> tuple[float, float]:
    """Rows, not necessarily whole, at which a parabola through the evidence of three counts is highest; and its std."""
    bend = 2.0 * total[1] - total[0] - total[2]
    if bend <= 0.0:
        return float(count), np.inf
    return count + float((total[2] - total[0]) / (2.0 * bend)), float(1.0 / np.sqrt(bend))


def _instant(losses: _Losses, skew: int, count: int) -> tuple[float, float]:
    """s: time at which a recording lost its rows, and its std: the mean of all instants, by likelihood."""
    falls = losses.falls(np.ones(len(losses.scatter)))[skew, count]
    time, variance = mean_time(losses.t, falls / 2.0)
    step = losses.t[1] - losses.t[0]
    return time, float(np.sqrt(variance + FILTERED**2 + step**2 / 12.0))
