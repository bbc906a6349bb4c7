"""Forward selection with joint refit and backward deletion, judged on held-out recordings.

A candidate enters only if the squared whitened error of whole held-out recordings falls by more than the scatter of that fall over blocks of
one second allows (``diagnosis.significance``), with false-discovery control over all candidates that were looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from diagnosis.significance import benjamini_hochberg, p_value

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """Columns of one candidate over all rows and joints, whitened: fit (N, k) and held out (M, k)."""

    fit: Array
    held_out: Array


@dataclass(frozen=True)
class Problem:
    """Whitened residuals: fit (N,), held_out (M,), and the block of each row, numbered from 0 over all recordings."""

    fit: Array
    held_out: Array
    fit_block: NDArray[np.intp]
    held_out_block: NDArray[np.intp]


@dataclass(frozen=True)
class Step:
    """One look at one candidate: gains of held-out blocks, and of fit blocks, in units of variance of the noise."""

    key: object
    coefficients: Array
    fit_gain: float
    held_out_gain: float
    p: float
    blocks: Array = field(repr=False)


def least_squares(columns: Array, y: Array) -> Array:
    """Coefficients (k,) of y (N,) on columns (N, k), truncated where they are dependent (relative 1e-8)."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    coefficients: Array = np.linalg.lstsq(columns / scale, y, rcond=1e-6)[0] / scale
    return coefficients


def look(problem: Problem, accepted: list[Column], candidate: Column, key: object, before: tuple[Array, Array]) -> Step:
    """What the candidate adds to those accepted; ``before`` are the residuals (fit, held out) with the accepted ones alone."""
    fit = np.hstack([*(c.fit for c in accepted), candidate.fit])
    held_out = np.hstack([*(c.held_out for c in accepted), candidate.held_out])
    b = least_squares(fit, problem.fit)
    after = problem.held_out - held_out @ b
    blocks = np.bincount(problem.held_out_block, weights=before[1] ** 2 - after**2)
    fit_gain = float(np.sum(before[0] ** 2) - np.sum((problem.fit - fit @ b) ** 2))
    return Step(key, b, fit_gain, float(blocks.sum()), p_value(blocks), blocks)


def residuals(problem: Problem, accepted: list[Column]) -> tuple[Array, Array]:
    """Residuals (fit, held out) with the accepted columns refitted together."""
    if not accepted:
        return problem.fit, problem.held_out
    fit = np.hstack([c.fit for c in accepted])
    b = least_squares(fit, problem.fit)
    return problem.fit - fit @ b, problem.held_out - np.hstack([c.held_out for c in accepted]) @ b


def q_values(steps: list[Step]) -> Array:
    """Benjamini-Hochberg over the candidates of one round."""
    return benjamini_hochberg(np.array([step.p for step in steps]))
