"""When drifts began, between results as well as at them, and what a history says averaged over that.

A drift begins on any day. Its onset is therefore no known number: every onset is weighted by how well the history
fits with it (the likelihood of a residual whose variance is known with some degrees of freedom). Before the data each
day is as likely as another, and that it began before the first result, which is the same straight line as from the
first on, as likely as that it began during the results. Values, slopes and dates are averaged over all onsets, their
deviations included (Hoeting et al., Statistical Science 14 (1999) 382). With an onset that is chosen from the same data
and then taken as known, intervals of "95 %" held 75 to 85 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from scipy import stats

from arm_io.types import Array
from comparison.trend.history import History
from comparison.trend.terms import LEAST_RESULTS, Fit

POINTS = {1: 200, 2: 40, 3: 12}
"""Onsets of each drift that are tried, by the number of drifts; ``FEWEST_POINTS`` of more."""
FEWEST_POINTS = 6
COARSE = 64
"""Onsets that the search for the best one tries at a time."""
ZOOMS = 8
"""Times that the search narrows its range."""
FAR = 25.0
"""Onsets that fit worse than the best by this much in weighted squares (5 deviations) do not count."""


@dataclass(frozen=True)
class Onsets:
    """A fitted history for each of m combinations of onsets.

    begins        (m, k) day on which each of the k terms begins, steps at their result
    likelihoods   (m,) of each combination, 1 for the best
    weights       (m,) the same times how likely its onsets are without the data, 1 in sum
    coefficients  (m, 1 + k), the constant first; covariances (m, 1 + k, 1 + k), two deviations of which hold 95 %
    """

    begins: Array
    likelihoods: Array
    weights: Array
    coefficients: Array
    covariances: Array


def onsets_of(history: History, fitted: Fit, freedom: float) -> Onsets:
    """All onsets that the drifts of a fit may have; ``freedom``: degrees of freedom of the variance between results."""
    begins = np.array([history.days[term.at] for term in fitted.terms], float)
    drifts = sorted((k for k, term in enumerate(fitted.terms) if term.shape == "drift"), key=lambda k: begins[k])
    ranges: dict[int, tuple[float, float]] = {}
    for _ in drifts:
        for k in drifts:  # again, because the range of each depends on where the others begin
            allowed = _allowed(history, fitted, drifts, drifts.index(k))
            begins[k], ranges[k] = _near(history, fitted, begins, k, allowed)
    count = POINTS.get(len(drifts), FEWEST_POINTS)
    tried = list(product(*(np.linspace(*ranges[k], count) for k in drifts)))
    ordered = [one for one in dict.fromkeys(tried) if all(a < b for a, b in pairwise(one))] or tried[:1]
    combined = np.tile(begins, (len(ordered), 1))
    combined[:, drifts] = np.array(ordered).reshape(len(ordered), len(drifts))
    coefficients, covariances, squares = _fits(history, fitted, combined)
    # Deviations that allow for few blocks are wider than the raw ones by this factor.
    widened = float(np.median(history.std / history.raw)) ** 2
    worse = (squares - squares.min()) / widened
    keep = worse <= FAR
    begins, likelihoods = combined[keep], _likelihood(worse[keep], max(min(freedom, 1e6), 1.0))
    weights = likelihoods
    if drifts:
        low, high = ranges[drifts[0]]
        weights = weights * _prior(history.days, begins[:, drifts[0]], (high - low) / (count - 1))
    return Onsets(begins, likelihoods, weights / weights.sum(), coefficients[keep], widened * covariances[keep])


def _prior(days: Array, begins: Array, apart: float) -> Array:
    """(m,) how likely the onsets of the first drift, tried so many days apart, are without the data."""
    before = np.ptp(days) / apart if apart > 0 else 1.0
    return np.where(begins == days[0], before, 1.0)


def _allowed(history: History, fitted: Fit, drifts: list[int], place: int) -> tuple[float, float]:
    """First and last day on which a drift may begin: between its neighbours, and with results after it."""
    at = [fitted.terms[k].at for k in drifts]
    first = min(at[place - 1] + 1, at[place]) if place else 0
    last = max(at[place + 1] - 1, at[place]) if place + 1 < len(at) else max(len(history.days) - LEAST_RESULTS, 0)
    return float(history.days[first]), float(history.days[max(last, first)])


def _near(
    history: History, fitted: Fit, begins: Array, k: int, allowed: tuple[float, float]
) -> tuple[float, tuple[float, float]]:
    """The best onset of term ``k``, the others as they are, and the range outside which it fits far worse."""
    low, high = allowed
    days = np.linspace(low, high, min(max(COARSE, 2 * len(history.days)), 8 * COARSE))
    best = low
    for _ in range(ZOOMS):
        combined = np.tile(begins, (len(days), 1))
        combined[:, k] = days
        squares = _fits(history, fitted, combined)[2]
        best = float(days[np.argmin(squares)])
        (near,) = np.nonzero(squares <= squares.min() + FAR)
        low, high = float(days[max(near[0] - 1, 0)]), float(days[min(near[-1] + 1, len(days) - 1)])
        if len(near) > COARSE / 4:
            break
        days = np.linspace(low, high, COARSE)
    return best, (low, high)


def _fits(history: History, fitted: Fit, begins: Array) -> tuple[Array, Array, Array]:
    """Weighted least squares of each of m combinations of onsets: coefficients, covariances, weighted squares left."""
    total = np.sqrt(history.raw**2 + fitted.between)
    columns = [np.broadcast_to(1 / total, (len(begins), len(total)))]
    for k, term in enumerate(fitted.terms):
        since = history.days - begins[:, k, None]
        columns.append((np.maximum(since, 0.0) if term.shape == "drift" else (since >= 0)) / total)
    design = np.stack(columns, axis=2)
    y = history.values / total
    covariances = np.asarray(np.linalg.pinv(design.transpose(0, 2, 1) @ design, hermitian=True), float)
    coefficients = (covariances @ (design.transpose(0, 2, 1) @ y)[:, :, None])[:, :, 0]
    squares = np.sum((y - np.sum(design * coefficients[:, None, :], axis=2)) ** 2, axis=1)
    return coefficients, covariances, np.asarray(squares, float)


def each(onsets: Onsets, rows: Array) -> tuple[Array, Array]:
    """(m,) values and deviations of a linear combination ``rows`` (m or 1, 1 + k) of the coefficients."""
    values = np.sum(rows * onsets.coefficients, axis=1)
    variances = np.einsum("mi,mij,mj->m", rows, onsets.covariances, rows)
    return values, np.sqrt(np.maximum(variances, 0.0))


def averaged(onsets: Onsets, rows: Array) -> tuple[float, float]:
    """A linear combination of the coefficients and its deviation, two of which hold 95 %, over all onsets."""
    values, std = each(onsets, rows)
    mean = float(onsets.weights @ values)
    return mean, math.sqrt(float(onsets.weights @ (std**2 + (values - mean) ** 2)))


def interval(onsets: Onsets, k: int, freedom: float) -> tuple[float, float]:
    """Days between which term ``k`` began, with 95 %: all that fit nearly as well as the best."""
    degrees = max(min(freedom, 1e6), 1.0)
    least = _likelihood(float(stats.t.ppf(0.975, degrees)) ** 2, degrees)
    days = np.unique(onsets.begins[:, k])
    near = onsets.begins[onsets.likelihoods >= least, k]
    low, high = np.searchsorted(days, [near.min(), near.max()])
    return float(days[max(low - 1, 0)]), float(days[min(high + 1, len(days) - 1)])


def _likelihood(worse: Array | float, degrees: float) -> Array:
    """Of an onset that fits worse by so many squares, where the variance is known with ``degrees``; 1 for the best."""
    return np.asarray((1 + np.asarray(worse) / degrees) ** (-(degrees + 1) / 2))
