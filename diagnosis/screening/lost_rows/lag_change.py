"""A change of the currents' lag by a few rows at one instant, by its first-order effect on the residual.

The lag against the angles is estimated per second and per joint: the projection of the residual on the derivative of
the current. ``lag_path`` finds lags that are too long for this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.residual.run import Run

Index = NDArray[np.intp]

PIECE = 0.25
"""s: length of the pieces for which a lag is estimated."""
OTHERS = 4.0
"""Std that the change at the joints other than the most certain one must exceed, and within which it must agree."""
COLOURED = 16.0
"""Rows over which other errors correlate the residual."""
FILTERED = 0.02
"""s by which filters smear an instant."""
BALANCED = 0.03
"""Least ratio of the weights before and after the change at a joint that shows it."""
APART = 2e-4
"""s by which the lags of the joints differ because of other errors."""
FEWEST = 6
"""Pieces needed on either side of the change."""


@dataclass(frozen=True)
class Change:
    """The lag of the currents, s, changes by ``step`` (standard deviation ``std``) at ``time`` s of a run."""

    time: float
    step: float
    std: float


def part_of(run: Run, start: float, end: float) -> Run:
    """The rows of a run from ``start`` to ``end`` s, with what a lag is estimated from."""
    rows = (run.t >= start) & (run.t < end)
    return replace(
        run,
        t=run.t[rows],
        current=run.current[rows],
        current_rate=run.current_rate[rows],
        expected=run.expected[rows],
        deviation=run.deviation[rows],
        instruments=run.instruments[rows],
    )


def change_of_lag(run: Run) -> Change | None:
    """The instant that splits a run's lags best, each joint with a lag of its own before it; None for a short run."""
    lag, weight, pieces = _lags(run)
    if len(lag) <= 2 * FEWEST:
        return None
    best = None
    for at in range(FEWEST, len(lag) - FEWEST):
        step, fall = _step(lag, weight, at)
        if best is None or fall > best[2]:
            best = at, step, fall
    assert best is not None
    return _change(lag, weight, pieces, best[0])


def change_at(run: Run, time: float) -> Change | None:
    """The change of a run's lag at ``time`` s; None where no two joints determine it."""
    if len(run.t) == 0:
        return None
    lag, weight, pieces = _lags(run)
    at = int(np.searchsorted(pieces, time))
    return _change(lag, weight, pieces, at, agree=False) if 0 < at < len(lag) else None


def mean_lag(run: Run) -> float:
    """s: the lag that the joints have in common; 0 without rows."""
    if len(run.t) == 0:
        return 0.0
    lag, weight, _ = _lags(run)
    return float(np.sum(weight * lag) / max(float(np.sum(weight)), 1e-300))


def _change(lag: Array, weight: Array, pieces: Array, at: int, *, agree: bool = True) -> Change | None:
    """The step between pieces ``at`` - 1 and ``at``; these two may contain the instant, and do not count."""
    weight = weight.copy()
    weight[max(at - 1, 1) : at + 1] *= 1e-6
    step, _ = _step(lag, weight, at)
    after = (np.arange(len(lag)) >= at)[:, None]
    residual = lag - step * after - _means(lag - step * after, weight)
    # scatter per joint, since it includes other errors of this joint
    scatter = np.sum(weight * residual**2, axis=0) / max(len(lag) - 2, 1)
    per_joint = _steps_by_joint(lag, weight, at)
    shows, inverse_variance = _on_both_sides(weight, at), np.zeros(len(scatter))
    residual, weight = residual[:, shows], weight[:, shows]
    variance = np.maximum(scatter[shows] * _leverage(weight, at), _of_pieces(residual, weight, at))
    inverse_variance[shows] = 1.0 / np.maximum(variance, 1e-300)
    if not np.any(inverse_variance > 0.0) or (agree and not _agreed(per_joint, inverse_variance)):
        return None
    step = float(np.sum(inverse_variance * per_joint) / np.sum(inverse_variance))
    std = float(1.0 / np.sqrt(np.sum(inverse_variance)))
    disagreement = float(np.sum(inverse_variance * (per_joint - step) ** 2)) / max(len(per_joint) - 1, 1)
    return Change(float(pieces[at]), step, std * float(np.sqrt(max(disagreement, 1.0))))


def _agreed(per_joint: Array, inverse_variance: Array) -> bool:
    """Whether the joints other than the most certain one show the same step of the lag.

    Dropped triggers affect all joints; a step at one joint alone has another cause.
    """
    best = int(np.argmax(inverse_variance))
    other_weights = np.delete(inverse_variance, best)
    if not np.any(other_weights > 0.0):
        return False  # no other joint determines the step
    step, std = (
        float(np.sum(np.delete(inverse_variance * per_joint, best)) / np.sum(other_weights)),
        float(1.0 / np.sqrt(np.sum(other_weights))),
    )
    difference = abs(step - per_joint[best])
    return abs(step) > OTHERS * std and difference < OTHERS * float(
        np.hypot(std, 1.0 / np.sqrt(inverse_variance[best]))
    ) + 0.2 * abs(step)


def _lags(run: Run) -> tuple[Array, Array, Array]:
    """lag (p, n) s of the currents in each piece, its weight (p, n), and the start (p,) s of each piece.

    The weight is the inverse variance, provided that the residual is noise.
    """
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


def _on_both_sides(weight: Array, at: int) -> NDArray[np.bool_]:
    """(n,) whether a joint's current changed enough before and after; else other errors cause lags of milliseconds."""
    sides = weight[:at].sum(axis=0), weight[at:].sum(axis=0)
    on_both: NDArray[np.bool_] = np.minimum(*sides) > BALANCED * np.maximum(*sides)
    return on_both


def _steps_by_joint(lag: Array, weight: Array, at: int) -> Array:
    return _means(lag[at:], weight[at:]) - _means(lag[:at], weight[:at])


def _leverage(weight: Array, at: int) -> Array:
    """(n,) variance of each joint's step in units of its scatter."""
    leverage: Array = 1.0 / np.maximum(weight[at:].sum(axis=0), 1e-300) + 1.0 / np.maximum(
        weight[:at].sum(axis=0), 1e-300
    )
    return leverage


def _of_pieces(residual: Array, weight: Array, at: int) -> Array:
    """(n,) variance of each joint's step by what its own pieces miss (HC2: MacKinnon & White, J. Econom. 29, 1985).

    A joint that moves for a second of a recording shows its lag in a few pieces; that many pieces at rest agree says
    nothing of what these miss.
    """
    variance = np.zeros(weight.shape[1])
    for side in (slice(None, at), slice(at, None)):
        share = weight[side] / np.maximum(weight[side].sum(axis=0), 1e-300)
        variance += np.sum((share * residual[side]) ** 2 / np.maximum(1.0 - share, 1e-6), axis=0)
    return variance


def _step(lag: Array, weight: Array, at: int) -> tuple[float, float]:
    """Common step at piece ``at`` and the fall of the weighted squared error by it."""
    steps, gain = _steps_by_joint(lag, weight, at), 1.0 / _leverage(weight, at)
    step = float(np.sum(gain * steps) / np.sum(gain))
    return step, float(np.sum(gain)) * step**2


def instant_of(run: Run, change: Change) -> tuple[float, float]:
    """Time of the change and its std: the mean of all instants, weighted by their likelihood.

    Each joint's lag l before the change is unknown, but near the one c that all have (time skew): at every instant the
    sum over joints of l^2 W - 2 l b + (l - c)^2 / ``APART``^2 has its least over l and c in closed form. Rows are
    correlated over ``COLOURED`` of them.
    """
    slope, residual = run.current_rate / run.deviation, run.residual / run.deviation
    after = (run.t >= change.time)[:, None]
    lag = -np.sum(slope * (residual + change.step * after * slope), axis=0) / np.sum(slope**2, axis=0)
    scatter = COLOURED * np.mean((residual + (lag + change.step * after) * slope) ** 2, axis=0)
    size, toward = slope**2 / scatter, -slope * residual / scatter
    size_after, toward_after = (np.cumsum(values[::-1], axis=0)[::-1] for values in (size, toward))
    w, b = size.sum(axis=0) + APART**-2, toward.sum(axis=0) - change.step * size_after
    common = np.sum(b / w, axis=1) / np.sum(1.0 - APART**-2 / w)  # c where the error is least
    error = np.sum(change.step**2 * size_after - 2 * change.step * toward_after - b**2 / w, axis=1)
    error -= common**2 * APART**-2 * np.sum(1.0 - APART**-2 / w)
    time, variance = mean_time(run.t, -error / 2)
    return time, float(np.hypot(np.sqrt(variance), FILTERED))


def mean_time(t: Array, log_likelihood: Array) -> tuple[float, float]:
    """Mean, s, and variance, s2, of instants t (m,) s, weighted by their likelihood."""
    likely = np.exp(log_likelihood - log_likelihood.max())
    likely /= likely.sum()
    mean = float(np.sum(likely * t))
    return mean, float(np.sum(likely * (t - mean) ** 2))
