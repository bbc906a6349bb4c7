"""One parameter as a random walk that residuals observe: Kalman filter, smoother, strength of the walk.

Every ``STEP`` of a recording is reduced to score H^T y and information H^T H of the weighted residual y = H x + e. From
one step alone, the deviation of the parameter is score / information, with variance 1 / information in units of the
noise variance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from arm_io.types import Array
from identification.selection import BLOCK_SECONDS

Steps = Sequence[tuple[Array, Array]]
"""Score and information (s,) of every recording."""

STEP = 0.1
"""s: rows within it are taken together."""
GAP = 0.3
"""s: prediction horizon of the walk, longer than the longest correlation of residuals seen in practice (0.25 s)."""


def filtered(score: Array, seen: Array, ratio: float) -> tuple[Array, Array]:
    """(s,) mean and variance of x at every step given all steps before it, in units of the noise's variance.

    score, seen (s,): H^T y and H^T H of every step. The variance is infinite before the first one with information.
    """
    count = len(score)
    mean, variance = np.zeros(count), np.zeros(count)
    x, p = 0.0, np.inf
    for k in range(count):
        mean[k], variance[k] = x, p
        if np.isinf(p) and seen[k] > 0.0:
            x, p = score[k] / seen[k], 1.0 / seen[k]
        elif seen[k] > 0.0:
            gain = p * seen[k] / (1.0 + p * seen[k])
            x, p = x + gain * (score[k] / seen[k] - x), p * (1.0 - gain)
        p += ratio
    return mean, variance


def prediction_errors(score: Array, seen: Array, ratio: float) -> tuple[NDArray[np.intp], Array, Array]:
    """Indices, prediction errors and their variances at the steps that can be predicted ``GAP`` ahead.

    Residuals are correlated over tenths of a second; a shorter horizon would mistake that correlation for a walk.
    """
    mean, variance = filtered(score, seen, ratio)
    gap = round(GAP / STEP)
    k = gap + np.flatnonzero((seen[gap:] > 0.0) & np.isfinite(variance[:-gap]))
    return k, score[k] / seen[k] - mean[k - gap], variance[k - gap] + gap * ratio + 1.0 / seen[k]


def predicted(steps: Steps) -> int:
    """Number of steps that can be predicted from others ``GAP`` before."""
    return sum(len(prediction_errors(score, seen, 0.0)[0]) for score, seen in steps)


def likelihood(steps: Steps, ratio: float) -> tuple[float, float]:
    """Log likelihood of the prediction errors at the best scale of the noise, and that scale."""
    squares, logs, count = 0.0, 0.0, 0
    for score, seen in steps:
        _, error, variance = prediction_errors(score, seen, ratio)
        squares += float(np.sum(error**2 / variance))
        logs += float(np.sum(np.log(variance)))
        count += len(error)
    scale = squares / max(count, 1)
    return -0.5 * (count * np.log(max(scale, 1e-300)) + logs), scale


def strength(steps: Steps) -> tuple[float, float]:
    """Variance of a step of the walk over that of the noise, at greatest likelihood; scale of the noise."""
    typical = 1.0 / np.median(np.concatenate([seen[seen > 0] for _, seen in steps]))
    grid = np.log(typical) + np.arange(-14.0, 7.0)
    best = int(np.argmax([likelihood(steps, float(np.exp(value)))[0] for value in grid]))
    minimum = optimize.minimize_scalar(
        lambda value: -likelihood(steps, float(np.exp(value)))[0],
        bounds=(grid[best] - 1.0, grid[best] + 1.0),
        method="bounded",
        options={"xatol": 0.05},
    )
    ratio = float(np.exp(minimum.x))
    return ratio, likelihood(steps, ratio)[1]


def gains_of(steps: Steps, ratio: float, constant: float) -> Array:
    """(blocks,) fall of the weighted squared residual per block of 1 s.

    It compares the predictions of the walk with the best constant.
    """
    blocks = []
    for score, seen in steps:
        k, error, _ = prediction_errors(score, seen, ratio)
        still = score[k] / seen[k] - constant
        blocks.append(np.bincount((k * STEP / BLOCK_SECONDS).astype(int), weights=seen[k] * (still**2 - error**2)))
    return np.concatenate(blocks)


def smoothed(score: Array, seen: Array, ratio: float) -> tuple[Array, Array]:
    """(s,) mean and variance of x at every step given all of the recording (Fraser & Potter, IEEE T-AC 14, 1969).

    Arguments and units as of ``filtered``.
    """
    if ratio == 0.0:
        total = max(float(seen.sum()), 1e-300)
        return np.full(len(seen), score.sum() / total), np.full(len(seen), 1.0 / total)
    before, before_variance = filtered(score, seen, ratio)
    after, after_variance = (values[::-1] for values in filtered(score[::-1], seen[::-1], ratio))
    known = np.maximum(seen + 1.0 / before_variance + 1.0 / after_variance, 1e-300)
    return (score + before / before_variance + after / after_variance) / known, 1.0 / known


def memory(steps: Steps, ratio: float) -> float:
    """s: time constant of the smoother in its steady state."""
    mean = float(np.mean(np.concatenate([seen for _, seen in steps])))
    return STEP / np.sqrt(max(ratio * mean, 1e-12))
