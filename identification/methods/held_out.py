"""Two fits compared on held-out rows: whether what one of them has more reduces the error beyond chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from identification.methods.solution import Solution
from identification.regression.conclusion import SPLIT
from identification.regression.equations import Equations
from identification.selection import p_value


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Rms errors (N m, N) of two fits on some held-out rows; p: probability of such a gain by chance, by blocks."""

    before: float
    after: float
    p: float


@dataclass(frozen=True)
class HeldOutResiduals:
    """Residuals (rows,) N m (N) of two fits of the same held-out rows: without a term, and with it."""

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
