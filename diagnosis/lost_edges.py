"""Edges of the trigger that one group of channels lost: from one row on its currents belong to later rows, and the lag against the angles changes.

The lag is looked for second by second, joint by joint: what the residual has of the derivative of the current. A lag that is there all the
time is time skew and stays; one that changes at one instant, by whole rows, alike at all joints that can tell, is lost edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.events import Event
from diagnosis.evidence import Run
from diagnosis.parameters import Estimate

Array = NDArray[np.float64]
Index = NDArray[np.intp]

PIECE = 0.25
"""s: within a piece the lag is one number."""
SURE = 7.0
"""Standard deviations of the change: it is the largest among all instants, of data with other things wrong in it."""
OTHERS = 4.0
"""Standard deviations by which the joints other than the best one must show the change, and within which they must agree with it."""
WHOLE = 0.3
"""Rows by which a change of lag may miss a whole number."""
MOST_ROWS = 12
FEWEST = 6
"""Pieces wanted on either side of the change."""


@dataclass(frozen=True)
class Change:
    """The lag of the currents, s, changes by ``step`` (standard deviation ``std``) at ``time`` s of a run, known to ``time_std``."""

    time: float
    time_std: float
    step: float
    std: float


def lost_edges(runs: Sequence[Run], periods: Sequence[float]) -> list[Event]:
    """One event a recording that lost edges: ``periods`` s between the rows of each."""
    events = []
    for index, (run, period) in enumerate(zip(runs, periods)):
        change = change_of_lag(run)
        if change is None or abs(change.step) < SURE * change.std or change.std > WHOLE * period:
            continue
        rows = -change.step / period
        count = round(rows)
        if count == 0 or abs(rows - count) > WHOLE or abs(count) > MOST_ROWS:
            continue
        group = "currents" if count > 0 else "angles"
        first = run.raw[0][0]
        events.append(
            Event(
                "dropped_trigger",
                0,
                [
                    Estimate("row", float(round((change.time - first) / period)), change.time_std / period, "1"),
                    Estimate("count", float(count), max(change.std / period, 0.05), "1"),
                    Estimate("period", period, 1e-3 * period, "s"),
                ],
                f"the lag of the currents of {run.name} changes by {change.step * 1e3:.2f} ms, {rows:.2f} rows, at {change.time:.2f} s and stays: "
                f"from there on the {group} belong to rows {abs(count)} later",
                (index,),
            )
        )
    return events


def change_of_lag(run: Run) -> Change | None:
    """The instant that splits a run's lags best, each joint with a lag of its own before it; None for a short run."""
    lag, weight, pieces = _lags(run)
    if len(lag) < 2 * FEWEST:
        return None
    best = None
    for at in range(FEWEST, len(lag) - FEWEST):
        step, fall = _step(lag, weight, at)
        if best is None or fall > best[2]:
            best = at, step, fall
    assert best is not None
    at, step, _ = best
    after = (np.arange(len(lag)) >= at)[:, None]
    level = _means(lag - step * after, weight)
    left = lag - step * after - level
    # each joint's own scatter: what else is wrong there is in it
    scatter = np.sum(weight * left**2, axis=0) / max(len(lag) - 2, 1)
    per_joint = _steps_by_joint(lag, weight, at)
    known = 1.0 / np.maximum(scatter * _leverage(weight, at), 1e-300)
    if not _agreed(per_joint, known):
        return None
    step = float(np.sum(known * per_joint) / np.sum(known))
    std = float(1.0 / np.sqrt(np.sum(known)))
    disagree = float(np.sum(known * (per_joint - step) ** 2)) / max(len(per_joint) - 1, 1)
    time, time_std = _instant(run, pieces, at, step)
    return Change(time, time_std, step, std * float(np.sqrt(max(disagree, 1.0))))


def _agreed(per_joint: Array, known: Array) -> bool:
    """Whether the joints other than the one that knows best show the same step (inverse variances ``known``): trigger edges are lost for all,
    and what is wrong with one joint alone is something else."""
    best = int(np.argmax(known))
    others = np.delete(known, best)
    if not np.any(others > 0.0):
        return False  # nobody to agree with
    step, std = float(np.sum(np.delete(known * per_joint, best)) / np.sum(others)), float(1.0 / np.sqrt(np.sum(others)))
    apart = abs(step - per_joint[best])
    return abs(step) > OTHERS * std and apart < OTHERS * float(np.hypot(std, 1.0 / np.sqrt(known[best]))) + 0.2 * abs(
        step
    )


def _lags(run: Run) -> tuple[Array, Array, Array]:
    """lag (p, n) s of the currents in each piece, its weight (p, n) (inverse variance if the residual were noise), and the pieces' starts (p,)."""
    slope, residual = run.current_rate / run.deviation, run.residual / run.deviation
    number: Index = ((run.t - run.t[0]) // PIECE).astype(np.intp)
    count = int(number[-1]) + 1
    total: Array = np.stack([np.bincount(number, weights=column, minlength=count) for column in (slope**2).T], axis=1)
    inner: Array = np.stack(
        [np.bincount(number, weights=column, minlength=count) for column in (-slope * residual).T], axis=1
    )
    return inner / np.maximum(total, 1e-12), total, np.asarray(run.t[0] + PIECE * np.arange(count), float)


def _means(lag: Array, weight: Array) -> Array:
    means: Array = np.sum(weight * lag, axis=0) / np.maximum(np.sum(weight, axis=0), 1e-300)
    return means


def _steps_by_joint(lag: Array, weight: Array, at: int) -> Array:
    return _means(lag[at:], weight[at:]) - _means(lag[:at], weight[:at])


def _leverage(weight: Array, at: int) -> Array:
    """(n,) variance of each joint's step in units of its scatter."""
    leverage: Array = 1.0 / np.maximum(weight[at:].sum(axis=0), 1e-300) + 1.0 / np.maximum(
        weight[:at].sum(axis=0), 1e-300
    )
    return leverage


def _step(lag: Array, weight: Array, at: int) -> tuple[float, float]:
    """Common step at piece ``at`` and the fall of the weighted squared error by it."""
    each, gain = _steps_by_joint(lag, weight, at), 1.0 / _leverage(weight, at)
    step = float(np.sum(gain * each) / np.sum(gain))
    return step, float(np.sum(gain)) * step**2


def _instant(run: Run, pieces: Array, at: int, step: float) -> tuple[float, float]:
    """Time of the change within a piece either way, and its deviation: where the squared error is within four of its least."""
    rows = np.flatnonzero((run.t >= pieces[max(at - 2, 0)]) & (run.t < pieces[min(at + 2, len(pieces) - 1)]))
    slope, residual = (values[rows] / run.deviation[rows] for values in (run.current_rate, run.residual))
    level = -np.sum(slope * residual, axis=0) / np.sum(slope**2, axis=0) - step / 2
    before, after = (np.sum((residual + (level + s) * slope) ** 2, axis=1) for s in (0.0, step))
    error = np.concatenate([[0.0], np.cumsum(before - after)]) + np.sum(after)
    times = run.t[rows]
    near = np.flatnonzero(error[:-1] <= error[:-1].min() + 4.0 * max(1.0, float(np.median(after)) / residual.shape[1]))
    return float(times[int(np.argmin(error[:-1]))]), float(np.ptp(times[near]) / 4 + PIECE / 10)


def put_back(current: Array, event: Event) -> Array:
    """(k, n) currents with the rows after the loss moved back where they belong; the rows lost are bridged."""
    found = {p.name: p.value for p in event.parameters}
    row, count = int(found["row"]), int(found["count"])
    rows = np.arange(len(current), dtype=float)
    source = np.where(rows >= row + max(count, 0), rows - count, np.minimum(rows, row))
    lower = np.clip(np.floor(source).astype(int), 0, len(current) - 1)
    return np.asarray(current[lower], float)
