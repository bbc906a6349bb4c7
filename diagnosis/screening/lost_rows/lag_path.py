"""The lag of the currents against the motion as a path: constant but for changes at instants, of any size.

The measured current of every piece of the recording is compared with the predicted current of rows earlier and later.
Dynamic programming finds the path of lags that explains all pieces and joints best, at a price for every change
(Bellman and Roth, "Curve fitting by segmented straight lines", J. American Statistical Association 64, 1969, with
constants in place of lines). A lag here may be far longer than the first-order effect
of a lag holds (``lag_change``); ``lost_triggers`` refines it by rows.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_change import COLOURED, FILTERED, mean_time

Index = NDArray[np.intp]

PIECE = 50
"""Rows of a run for which one lag is compared; their mean residual is a load that the model lacks, no lag."""
LONGEST = 5.0
"""s: longest lag that is looked for; at most a quarter of the recording."""
PRICE = 60.0
"""Fall of the normalised squared error that a change of lag must bring."""
OTHERS = 16.0
"""Part of that fall which the joints other than the one that shows it best must bring."""
BEFORE = 1.0
"""Fall that the part before a change must show at those joints for its own lag: a joint that is wrong in another way
chooses any lag while the others rest."""
WORSE = 0.05
"""Of that part, how much worse one joint may become."""
EMERGED = 4.0
"""Ratio of the squared errors after and before, above the noise and as lags in s2, both at the lag before: other errors
do not emerge."""
REMAINING = 0.6
"""Share of its squared error that may be left of a part after the change: other errors follow a lag a little, too."""
MOST = 0.6
"""Share of a piece's rows that must lie within the recording at a lag."""
QUIET = 0.05
"""Mean square rate of a current in a piece, in that of the recording, below which the piece shows no lag."""
SMALLEST_RESIDUAL = 3.0
"""Whitened residual, rms of the worst piece, below which no change of lag is looked for."""


@dataclass(frozen=True)
class Step:
    """From ``time`` s of a run on the currents belong to rows ``step`` s later."""

    time: float
    step: float


def lag_steps(run: Run) -> list[list[Step]]:
    """The changes of lag of a run by at least two of its rows, in time: the possible ones, of several or of none.

    By all rows alike, and by rows as certain as they are (``Run.deviation``): friction that turns abruptly shows a lag
    best where the model has it right, and worst where it has not.
    """
    if not worth_looking(run):
        return []
    shares = np.ones_like(run.deviation), (run.instruments / run.deviation) ** 2
    found = [steps for share in shares if (steps := _steps_by(run, share)) and in_order(steps)]
    return found[:1] if found[1:] == found[:1] else found


def _steps_by(run: Run, share: Array) -> list[Step]:
    """The changes of lag, of rows that count by their ``share`` (m, n) of what the noise of an instrument would."""
    pieces = np.arange(0, len(run.t) - PIECE + 1, PIECE)
    longest = min(int(LONGEST * run.per_second), len(run.t) // 4)
    moving = _moving(run, pieces)
    errors = _errors(run, share, pieces, longest)  # (K, p, n)
    scale = np.median(errors.min(axis=0), axis=0) / PIECE + np.mean(run.instruments**2, axis=0)
    errors = (errors - _of_pieces(share * run.instruments**2, pieces)) * moving
    path = _cheapest(errors / (scale * COLOURED)) - longest
    steps = []
    for begin, start, at, end in _changes(path):
        before, after = int(path[start]), int(path[at])
        without, with_it = (errors[lag + longest, at:end].sum(axis=0) / (scale * COLOURED) for lag in (before, after))
        at_later_lag, at_own_lag = (errors[lag + longest, begin : start + 1].sum(axis=0) for lag in (after, before))
        lag_is_known = _of_others((at_later_lag - at_own_lag) / (scale * COLOURED)) > BEFORE
        parts = pieces[begin], pieces[start] + PIECE, pieces[at], pieces[end - 1] + PIECE
        size = [float(np.sum((share * run.current_rate**2)[a:b] / scale)) for a, b in (parts[:2], parts[2:])]
        fitted, lagged = float(np.sum(at_own_lag / scale)) / size[0], float(np.sum(without)) * COLOURED / size[1]
        if abs(after - before) > 1 and lag_is_known and lagged > EMERGED * fitted and _agreed(without, with_it):
            lags = before / run.per_second, after / run.per_second
            edge = float(run.t[pieces[at]])
            time, _ = instant(run, lags, (edge - 3 * PIECE / run.per_second, edge + 3 * PIECE / run.per_second))
            steps.append(Step(time, lags[1] - lags[0]))
    return steps


def in_order(steps: Sequence[Step]) -> bool:
    """Whether steps follow one another in time, among the currents and among the angles, from the first row on.

    Those of lost rows do. Lags that another error of the currents chooses, piece by piece, need not. Where angles were
    lost, the instant among them is that of the first one after the loss.
    """
    shifts = itertools.accumulate((step.step for step in steps), initial=0.0)
    places = [0.0, *(step.time + shift + min(step.step, 0.0) for step, shift in zip(steps, shifts))]
    times = [0.0, *(step.time for step in steps)]
    return all(a < b for several in (times, places) for a, b in itertools.pairwise(several))


def _changes(path: Index) -> list[tuple[int, int, int, int]]:
    """(begin of the part before, its last piece, piece after, end of the part after) of every change.

    A piece in the middle of one is skipped. Lags that differ by one row are one part: so short a change is none of this
    path, and what is judged on either side of the next one must be long.
    """
    edges, lag = [0], int(path[0])
    for piece, lag_here in enumerate(path.tolist()):
        if abs(lag_here - lag) > 1:
            edges.append(piece)
            lag = lag_here
    edges.append(len(path))
    parts = [(a, b) for a, b in itertools.pairwise(edges) if b - a > 1]
    return [(first[0], first[1] - 1, second[0], second[1]) for first, second in itertools.pairwise(parts)]


def _agreed(without: Array, with_it: Array) -> bool:
    """Whether joints (n,) agree on a change: normalised squared errors of the part after it without and with it.

    Rows lost by a device shift all its currents alike; an error of one joint alone has another cause.
    """
    fall = without - with_it
    others = _of_others(fall)
    explained = float(np.sum(with_it)) < REMAINING * float(np.sum(without))
    return others > OTHERS and float(fall.min()) > -WORSE * others and explained


def _of_others(fall: Array) -> float:
    """Sum of what joints (n,) gain, without the joint that gains most."""
    return float(np.sum(fall) - fall.max())


def put_back(values: Array, t: Array, steps: Sequence[Step]) -> Array:
    """(m, n) values at t (m,) s moved to where they belong; rows without a measurement are interpolated."""
    belongs = t + sum((step.step * (t >= step.time) for step in steps), np.zeros(len(t)))
    order = np.argsort(belongs, kind="stable")
    return np.stack([np.interp(t, belongs[order], column[order]) for column in values.T], axis=1)


def _moving(run: Run, pieces: Index) -> NDArray[np.bool_]:
    """(p, n) whether a current changes enough in a piece: at rest, an offset would look like a lag."""
    energy = _of_pieces(run.current_rate**2, pieces)
    moving: NDArray[np.bool_] = energy > QUIET * energy.mean(axis=0)
    return moving


def worth_looking(run: Run) -> bool:
    """Whether a run is long enough, and its worst piece so far off, that a change of lag may be looked for."""
    if len(run.t) < 4 * PIECE:
        return False
    pieces = np.arange(0, len(run.t) - PIECE + 1, PIECE)
    return bool(np.sqrt(_of_pieces(run.whitened**2, pieces).max() / PIECE) > SMALLEST_RESIDUAL)


def _of_pieces(squares: Array, pieces: Index) -> Array:
    """(p, n) sums of values (m, n) over every piece."""
    return np.asarray(np.add.reduceat(squares[: pieces[-1] + PIECE], pieces, axis=0))


def _errors(run: Run, share: Array, pieces: Index, longest: int) -> Array:
    """(2 longest + 1, p, n) A2: squared error of each piece by the lag at which currents are compared.

    The mean of each piece is taken out: a load that the model has not would shift it as a lag does.
    A lag that leads most rows of a piece out of the recording counts as the nearest that does not.
    """
    lags = np.arange(-longest, longest + 1)
    known = np.pad(np.ones(len(run.t)), longest)
    level = run.expected.mean(axis=0)  # without it, sums of squares keep their digits
    expected = np.pad(run.expected - level, ((longest, longest), (0, 0)))
    errors = np.empty((len(lags), len(pieces), run.current.shape[1]))
    for p, first in enumerate(pieces.tolist()):
        near, rows = slice(first, first + 2 * longest + PIECE), slice(first, first + PIECE)
        whole = bool(known[near].all())
        measured = run.current[rows] - run.current[rows].mean(axis=0)
        for j, (own, weight, predicted) in enumerate(zip(measured.T, share[rows].T, (expected[near]).T)):
            # of each lag, the weighted sums over the rows within the recording
            ones, firsts, seconds = (
                np.sum(x) if whole else _products(known[near], x) for x in (weight, weight * own, weight * own**2)
            )
            sums = firsts - _products(predicted, weight)
            squares = seconds - 2.0 * _products(predicted, weight * own) + _products(predicted**2, weight)
            ones, whole_weight = np.maximum(ones, MOST * np.sum(weight)), np.sum(weight)
            errors[:, p, j] = whole_weight * (squares / ones - (sums / ones) ** 2)
    lead = int((1 - MOST) * PIECE)
    nearest = np.clip(lags[:, None], -pieces - lead, len(run.t) - PIECE - pieces + lead)
    return errors[nearest + longest, np.arange(len(pieces))]


def _products(values: Array, piece: Array) -> Array:
    """(m - PIECE + 1,) sums of products of a piece (PIECE,) and the values (m,) from each row on."""
    return np.correlate(values, piece, "valid")


def _cheapest(errors: Array) -> Index:
    """(p,) index of the lag in every piece, of the path whose errors (K, p, n) and changes cost least."""
    cost = errors.sum(axis=2).T
    best, came_from = cost[0].copy(), np.empty(cost.shape, dtype=np.intp)
    stay = np.arange(cost.shape[1])
    for p in range(1, len(cost)):
        cheapest = int(np.argmin(best))
        came_from[p] = np.where(best <= best[cheapest] + PRICE, stay, cheapest)
        best = best[came_from[p]] + PRICE * (came_from[p] != stay) + cost[p]
    path = np.empty(len(cost), dtype=np.intp)
    path[-1] = int(np.argmin(best))
    for p in range(len(cost) - 1, 0, -1):
        path[p - 1] = came_from[p][path[p]]
    return path


def instant(run: Run, lags: tuple[float, float], near: tuple[float, float]) -> tuple[float, float]:
    """(time, std) s of the change between two lags (s) between the times ``near``: the mean of all, by likelihood.

    Times are those of the currents. These are put back to their angles, whose rows count as certain as they are
    (``Run.deviation``): friction that turns abruptly is where a model errs most. Rows that were lost count as little.
    """
    rows = (run.t >= near[0] + lags[0]) & (run.t < near[1] + max(lags))
    t, deviation = run.t[rows], run.deviation[rows]
    before, after = ((_interpolated(run.t, run.current, t - lag) - run.expected[rows]) / deviation for lag in lags)
    instruments = np.mean((run.instruments[rows] / deviation) ** 2, axis=0)
    scale = COLOURED * (instruments + np.minimum(np.mean(before**2, axis=0), np.mean(after**2, axis=0)))
    lost = np.searchsorted(t, t + max(lags[1] - lags[0], 0.0))
    for _ in range(2):  # what is left of both parts is known once the instant is
        left, right = (np.cumsum(np.append(0.0, np.sum(error**2 / scale, axis=1))) for error in (before, after))
        likelihood = -(left[:-1] + right[-1] - right[lost]) / 2.0
        time, variance = mean_time(t, likelihood)
        scale = COLOURED * (instruments + np.mean(np.where((t < time)[:, None], before, after) ** 2, axis=0))
    return time - lags[0], float(np.hypot(np.sqrt(variance), FILTERED))


def _interpolated(t: Array, values: Array, at: Array) -> Array:
    return np.asarray(CubicSpline(t, values)(np.clip(at, t[0], t[-1])))
