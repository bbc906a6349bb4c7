"""The same number of rows lost in several recordings, judged by all of them together.

Of one recording whose joints move one after the other, or hardly, no change of lag is certain. A device that drops
triggers drops them in every recording alike: the likelihoods of a whole number of rows, each at an instant of its own,
are multiplied over the recordings (as of a change point with an unknown place: Hinkley, "Inference about the
change-point in a sequence of random variables", Biometrika 57, 1970).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from arm_io.types import Array
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_change import COLOURED, FILTERED
from diagnosis.screening.lost_rows.lag_path import Step, put_back

LONGEST = 0.012
"""s: longest change that its first-order effect on the residual shows."""
SURE, OTHERS = 24.5, 8.0
"""Evidence for the number in all recordings, and in the joints without any one of them: seven and four std."""
ODDS = 3.0
"""Evidence by which one recording has lost rows: 20 to 1."""
WHOLE = 0.3
"""Rows by which the change that fits best may miss the whole number, and largest std of it."""
PLACED = 1.0
"""s: largest std of an instant that counts; an error that grows slowly has none."""
RECORDINGS = 2
"""Recordings, at least, that must have lost rows."""
REPEATS = 3
NONE = np.zeros(1)


@dataclass(frozen=True)
class CommonCount:
    """``count`` (std ``count_std``) rows that currents belong to later, and since when: time and its std, s.

    instants: of each recording, by its index, that lost rows.
    """

    count: int
    count_std: float
    instants: dict[int, tuple[float, float]]


@dataclass(frozen=True)
class _Seen:
    """What a recording tells of lags: slope and residual (m, n) over their std, t (m,) s, s between its rows."""

    slope: Array
    residual: Array
    t: Array
    period: float

    def without(self, joint: int) -> _Seen:
        """The same without a joint (from 0)."""
        slope, residual = (np.delete(values, joint, axis=1) for values in (self.slope, self.residual))
        return _Seen(slope, residual, self.t, self.period)


def common_count(runs: Sequence[Run], periods: Sequence[float]) -> CommonCount | None:
    """The number of rows that several recordings lost alike; None where they do not show one."""
    most = int(LONGEST / max(periods, default=np.inf))
    if len(runs) < RECORDINGS or most == 0 or not all(len(run.t) for run in runs):
        return None
    seen = [_seen(run, period) for run, period in zip(runs, periods)]
    counts = np.array([float(n) for n in range(-most, most + 1) if n])
    by_count = _evidence(seen, counts)
    total = _together(by_count)
    best = int(np.argmax(total))
    count, joints = int(counts[best]), range(runs[0].current.shape[1])
    if total[best] < SURE or any(_contradicted([one.without(j) for one in seen], counts, best) for j in joints):
        return None
    lost = [k for k, evidence in enumerate(by_count[:, best]) if evidence > ODDS]
    count, rows, std, instants = _refined([runs[k] for k in lost], [seen[k] for k in lost], count)
    if count == 0 or abs(rows - count) > WHOLE or std > WHOLE:
        return None
    placed = [k for k, (_, time_std) in zip(lost, instants) if time_std < PLACED]
    if len(placed) < RECORDINGS or float(np.sum(by_count[placed, best])) < SURE:
        return None
    return CommonCount(count, max(std, abs(rows - count), 0.05), dict(zip(lost, instants)))


def _refined(
    runs: Sequence[Run], seen: Sequence[_Seen], count: int
) -> tuple[int, float, float, list[tuple[float, float]]]:
    """The count, the rows (not necessarily whole) that all fit best and their std, and the instants: time, std s.

    Estimated with the currents put back: the effect of a lag on the residual is of first order only.
    """
    rows, std, instants = 0.0, np.inf, [_instant(one, count) for one in seen]
    for _ in range(REPEATS):
        first = second = 0.0
        for run, one, (time, _) in zip(runs, seen, instants):
            back = [Step(time, count * one.period)]
            current, rate = put_back(run.current, run.t, back), put_back(run.current_rate, run.t, back)
            aligned = _seen(replace(run, current=current, current_rate=rate), one.period)
            here = min(int(np.searchsorted(run.t, time)), len(run.t) - 1)
            slope, bend = _fall(aligned, _scatter(aligned, NONE))
            first, second = first + slope[here] * one.period, second + bend[here] * one.period**2
        if second <= 0.0:
            return count, rows, np.inf, instants
        rows, std = count + float(first / second), 1.0 / float(np.sqrt(second))
        if round(rows) in (count, 0):
            break
        count = round(rows)
        instants = [_instant(one, count) for one in seen]
    return count, rows, std, instants


def _seen(run: Run, period: float) -> _Seen:
    return _Seen(run.current_rate / run.deviation, run.residual / run.deviation, run.t, period)


def _together(evidence: Array) -> Array:
    """(c,) evidence of all recordings for each count, (k, c) by recording; each lost rows or did not, at even odds."""
    return np.asarray(np.sum(np.logaddexp(0.0, evidence) - np.log(2.0), axis=0))


def _contradicted(seen: Sequence[_Seen], counts: Array, best: int) -> bool:
    """Whether these joints show too little of a count, or another one more."""
    total = _together(_evidence(seen, counts))
    return bool(total[best] < OTHERS or np.argmax(total) != best)


def _evidence(seen: Sequence[_Seen], counts: Array) -> Array:
    """(k, c) log of the likelihood of each count in each recording, at any instant alike, over that of no loss."""
    return np.stack([_evidence_of(one, counts, _scatter(one, counts)) for one in seen])


def _evidence_of(seen: _Seen, counts: Array, scatter: Array) -> Array:
    falls = _falls(seen, counts, scatter)
    return np.asarray(logsumexp(falls / 2.0, axis=1) - np.log(falls.shape[1]))


def _falls(seen: _Seen, counts: Array, scatter: Array) -> Array:
    """(c, m) fall of the normalised squared error by currents that belong so many rows later from each row on."""
    first, second = _fall(seen, scatter)
    lags = counts[:, None] * seen.period
    return np.asarray(2.0 * lags * first - lags**2 * second)


def _fall(seen: _Seen, scatter: Array) -> tuple[Array, Array]:
    """(m,) a and b of that fall, 2 a lag - b lag^2, from each row on.

    Each joint has a lag of its own before, by least squares: the residual is that lag times the rate.
    """
    size, toward = seen.slope**2 / scatter, seen.slope * seen.residual / scatter
    later, toward_later = (np.cumsum(values[::-1], axis=0)[::-1] for values in (size, toward))
    share = later / np.maximum(later[0], 1e-300)
    return np.sum(toward_later - share * toward_later[0], axis=1), np.sum(later * (1.0 - share), axis=1)


def _scatter(seen: _Seen, counts: Array) -> Array:
    """(n,) mean square of what the best of these counts leaves, times the rows over which it is correlated."""
    step, row = 0.0, 0
    for _ in range(REPEATS):
        after = (np.arange(len(seen.t)) >= row)[:, None]
        rest = seen.residual - step * after * seen.slope
        lag = np.sum(seen.slope * rest, axis=0) / np.maximum(np.sum(seen.slope**2, axis=0), 1e-300)
        scatter = np.maximum(COLOURED * np.mean((rest - lag * seen.slope) ** 2, axis=0), 1e-12)
        falls = _falls(seen, counts, scatter)
        best, row = divmod(int(np.argmax(falls)), falls.shape[1])
        step = float(counts[best]) * seen.period
    return np.asarray(scatter)


def _instant(seen: _Seen, count: int) -> tuple[float, float]:
    """s: time at which a recording lost its rows, and its std: the mean of all instants, by likelihood."""
    counts = np.array([float(count)])
    falls = _falls(seen, counts, _scatter(seen, counts))[0]
    likely = np.exp((falls - falls.max()) / 2.0)
    likely /= likely.sum()
    time = float(np.sum(likely * seen.t))
    return time, float(np.hypot(np.sqrt(np.sum(likely * (seen.t - time) ** 2)), FILTERED))
