"""Whether a richer friction law is justified: two fits compared on held-out rows on which a joint slides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.methods.solved import Solved, friction_sizes
from identification.regression.conclusion import SPLIT
from identification.regression.equations import Equations
from identification.regression.least_squares import Fit
from identification.regression.problem import Problem
from identification.ripples.search import BY_CHANCE, MATTERS
from identification.selection import BLOCK_SECONDS, p_value

REDUCED = 0.05
"""Of the rms error of a joint while it slides on held-out rows: what a richer law must take away to stay."""
LARGE, BY_CHANCE_IF_LARGE = 0.5, 0.05
"""Share of the error that a law leaves, at most, that may gain so by that chance: a short held-out recording has so few
blocks that all of them gain more often than ``BY_CHANCE``: eight, at each of four joints, in one of 64 cases."""
SLOWEST = 2.0
"""Times the lowest speed of a joint: slower rows are not free of the reversals beside them, and do not decide."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A richer law tried at one joint (from 1): rms errors (N m, N) on held-out sliding rows, and whether it stays.

    straight: without it; curve: with it; None where it slides on no held-out row. why: what speaks against a law that
    has no such rows, or a smaller error; else empty.
    """

    joint: int
    straight: float | None
    curve: float | None
    p: float
    stays: bool
    why: str = ""

    def compared(self, unit: str) -> str:
        """What was compared, as a report says it, in unit (N m, N)."""
        if self.straight is None:
            return self.why
        return f"held-out error while it slides {self.straight:.3g} -> {self.curve:.3g} {unit}"


def trial_of(j: int, before: Solved, after: Solved, slowest: float, tried: int) -> Trial:
    """Both fits at joint j (from 0) on held-out rows on which it slides; ``slowest``: rad/s (m/s), its lowest speed.

    tried: joints at which the same is tried.
    """
    one, other = (held_out_residual(fit) for fit in (before, after))
    rows = one[0]
    mine = (rows.joint == j) & (_speed(rows, j) > SLOWEST * slowest)
    mine = mine if rows.sliding is None else mine & rows.sliding
    if not mine.any():
        return Trial(joint=j + 1, straight=None, curve=None, p=1.0, stays=False, why="it slides on no held-out row")
    gain = (one[1] ** 2 - other[1] ** 2)[mine]
    _, block = np.unique(np.stack([rows.run[mine], rows.t[mine] // BLOCK_SECONDS]), axis=1, return_inverse=True)
    p = p_value(np.bincount(block.ravel(), weights=gain).astype(float))
    size, left = (float(np.sqrt(np.mean(each[mine] ** 2))) for each in (one[1], other[1]))
    removed = np.sqrt(max(size**2 - left**2, 0.0)) / friction_sizes(before.problem, before.best)[j]
    seldom = BY_CHANCE_IF_LARGE if left < LARGE * size else BY_CHANCE
    justified = p * tried < seldom and left < (1.0 - REDUCED) * size and removed > MATTERS
    why = ""
    if not justified and left < (1.0 - REDUCED) * size:
        why = f"noise gains as much with probability {min(p * tried, 1.0):.1g}"
        if removed <= MATTERS:
            why = f"a gain of {removed:.1%} of its Coulomb friction"
    return Trial(joint=j + 1, straight=size, curve=left, p=p, stays=bool(justified), why=why)


def _speed(rows: Equations, j: int) -> Array:
    """(rows,) rad/s (m/s) of joint j (from 0), as its columns of viscous friction have it."""
    viscous = [k for k, name in enumerate(rows.names) if name.startswith(f"joint{j + 1}.viscous")]
    return np.abs(rows.columns[:, viscous].sum(axis=1))


def held_out_residual(one: Solved) -> tuple[Equations, Array]:
    """Held-out rows and their residual; without held-out recordings the late part by a fit of the early one."""
    problem = one.problem
    if problem.held is not None:
        return problem.held, residual_of(problem, problem.held, one.best)
    ends = np.array([motion.t[-1] for motion in problem.motions])
    early = problem.rows.t < (SPLIT * ends)[problem.rows.run]
    late = problem.judged.of(problem.judged.t > SPLIT * ends[problem.judged.run])
    solve: Callable[[Equations], Fit] = one.solve
    return late, residual_of(problem, late, solve(problem.rows.of(early)))


def residual_of(problem: Problem, rows: Equations, fit: Fit) -> Array:
    """(rows,) what a fit leaves of the torques, N m (N)."""
    return np.asarray(rows.torque - problem.given(rows) - rows.columns[:, problem.columns] @ fit.values)
