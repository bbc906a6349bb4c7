"""Two fits compared on rows to which they were not fitted: whether one reduces the error beyond chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from identification.conclusion.predictions import SPLIT
from identification.methods.solution import Solution
from identification.regression.equations import Equations, joined
from identification.selection import p_value

STRETCH = 5.0
"""s of a recording that are predicted as a whole, at most: many times what filters correlate."""
FOLDS = 4
"""Every so many-th of these stretches is predicted together."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Rms errors (N m, N) of two fits on some held-out rows; p: probability of such a gain by chance, by blocks."""

    before: float
    after: float
    p: float


@dataclass(frozen=True)
class HeldOutResiduals:
    """Residuals (rows,) N m (N) of two fits of the same rows, fitted to others: without a term, and with it."""

    rows: Equations
    without: Array
    with_it: Array

    def on(self, chosen: NDArray[np.bool_]) -> Comparison | None:
        """On the ``chosen`` rows (rows,) that are free of reversals; None where there are none."""
        chosen = chosen if self.rows.sliding is None else chosen & self.rows.sliding
        if not chosen.any():
            return None
        before, after = (float(np.sqrt(np.mean(one[chosen] ** 2))) for one in (self.without, self.with_it))
        gains = (self.without**2 - self.with_it**2)[chosen]
        by_block = np.bincount(self.rows.of(chosen).blocks(), weights=gains).astype(float)
        return Comparison(before=before, after=after, p=p_value(by_block))


def held_out_residuals(without: Solution, with_it: Solution) -> HeldOutResiduals:
    """Of two fits whose problems have the same held-out rows."""
    (rows, one), (_, other) = held_out_residual(without), held_out_residual(with_it)
    return HeldOutResiduals(rows, one, other)


def held_out_residual(one: Solution) -> tuple[Equations, Array]:
    """Held-out rows and their residual (rows,) N m (N); else of the late part by a fit of the early one."""
    problem = one.problem
    if problem.held is not None:
        return problem.held, one.residual(problem.held)
    ends = np.array([motion.t[-1] for motion in problem.motions])
    early = problem.rows.t < (SPLIT * ends)[problem.rows.run]
    late = problem.judged.of(problem.judged.t > SPLIT * ends[problem.judged.run])
    return late, one.residual(late, one.solve(problem.rows.of(early)))


def cross_validated(without: Solution, with_it: Solution) -> HeldOutResiduals:
    """Of all rows, each stretch of the recordings predicted by fits of the other folds (K-fold cross-validation).

    Held-out recordings are a part of all: where they are short, the few blocks of them decide little. Rows on which a
    joint slides faster or slower than on all rows of the other folds are left out: friction there is extrapolated.
    Without held-out recordings, as ``held_out_residuals``: stretches of one motion that repeats itself would confirm
    what is true of this motion alone.
    """
    if without.problem.held is None:
        return held_out_residuals(without, with_it)
    (rows, one, inside), (_, other, _) = by_folds(without), by_folds(with_it)
    return HeldOutResiduals(rows.of(inside), one[inside], other[inside])


def by_folds(one: Solution) -> tuple[Equations, Array, NDArray[np.bool_]]:
    """The rows of all recordings, reversals and all, their residual (rows,) N m (N), and which to compare."""
    problem = one.problem
    judged, fitted = problem.judged, problem.rows
    if (held := problem.held) is not None:
        judged = joined([judged, held])
        fitted = joined([fitted, _sliding(held)])
    ends = np.zeros(int(judged.run.max(initial=0)) + 1)
    np.maximum.at(ends, judged.run, judged.t)
    stretch = min(STRETCH, float(ends.sum()) / FOLDS)
    residual, inside, fold = np.zeros(len(judged)), np.zeros(len(judged), bool), _fold(judged, stretch)
    for k in range(FOLDS):
        others, own = fitted.of(_fold(fitted, stretch) != k), judged.of(fold == k)
        if not len(others):  # every row that is free of reversals lies in this fold
            continue
        residual[fold == k] = one.residual(own, one.solve(others))
        shown, slowest, fastest = _sliding(others), np.full(len(problem.arm), np.inf), np.zeros(len(problem.arm))
        np.minimum.at(slowest, shown.joint, shown.speed())
        np.maximum.at(fastest, shown.joint, shown.speed())
        inside[fold == k] = (own.speed() >= slowest[own.joint]) & (own.speed() <= fastest[own.joint])
    return judged, residual, inside


def _fold(rows: Equations, stretch: float) -> NDArray[np.intp]:
    """(rows,) 0 to FOLDS - 1, of stretches of so many s."""
    return np.asarray((rows.t // max(stretch, 1e-9) + rows.run) % FOLDS, np.intp)


def _sliding(rows: Equations) -> Equations:
    """The rows that are free of reversals."""
    return rows if rows.sliding is None else rows.of(rows.sliding)
