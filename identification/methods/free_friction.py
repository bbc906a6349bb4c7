"""Whether the friction of a joint is a curve over speed or a straight line, decided on held-out rows.

Coulomb and viscous friction are a straight line over speed. A curve (``identification.regression.friction_shape``) is
tried at every joint that slides slowly and fast; it stays at the joints whose held-out error it reduces, by a share
that matters and in more blocks of time than chance allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array, Progress
from identification.methods.solved import Solved, friction_sizes, solved
from identification.regression.conclusion import SPLIT
from identification.regression.equations import Equations
from identification.regression.friction_shape import curve_speeds, with_curves
from identification.regression.least_squares import Fit, Method
from identification.regression.problem import Problem
from identification.selection import p_value

REDUCED = 0.05
"""Of the rms error of a joint while it slides on held-out rows: what a curve must take away to stay."""
MATTERS = 0.005
"""Of a joint's Coulomb friction: rms of the error that a curve takes away, at least."""
BY_CHANCE = 0.01
"""Probability, over all joints that were tried, that blocks of noise gain as much."""
SLOWEST = 2.0
"""Times the lowest speed of a curve: slower rows are not free of the reversals beside them, and do not decide."""
BLOCK = 1.0
"""s of the blocks of time in which gains are counted."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A curve tried at one joint (from 1): rms errors (N m, N) on held-out sliding rows, and whether it stays."""

    joint: int
    straight: float
    curve: float
    p: float
    stays: bool


def with_free_friction(
    straight: Solved, method: Method, *, always: bool, progress: Progress
) -> tuple[Solved, list[Trial]]:
    """The fit with curves at the joints where they are justified, and all trials; ``always``: where a shape shows."""
    problem = straight.problem
    speeds = {
        j: found
        for j, joint in enumerate(problem.arm.joints)
        if joint.friction_curve is None and (found := curve_speeds(problem.motions, j)) is not None
    }
    if not speeds:
        return straight, []
    progress("friction of free shape")
    curved = solved(with_curves(problem, speeds), method, progress)
    trials = [_trial(j, straight, curved, speed[0], len(speeds)) for j, speed in speeds.items()]
    trials = [replace(trial, stays=True) for trial in trials] if always else trials
    stay = {trial.joint - 1: speeds[trial.joint - 1] for trial in trials if trial.stays}
    if not stay:
        return straight, trials
    return (curved if len(stay) == len(speeds) else solved(with_curves(problem, stay), method, progress)), trials


def _trial(j: int, straight: Solved, curved: Solved, slowest: float, tried: int) -> Trial:
    """Both fits at joint j (from 0) on held-out rows on which it slides; ``slowest``: lowest speed of its curve."""
    before, after = (_held_out_residual(one) for one in (straight, curved))
    rows = before[0]
    mine = (rows.joint == j) & (_speed(rows, j) > SLOWEST * slowest)
    mine = mine if rows.sliding is None else mine & rows.sliding
    if not mine.any():
        return Trial(joint=j + 1, straight=0.0, curve=0.0, p=1.0, stays=False)
    gain = (before[1] ** 2 - after[1] ** 2)[mine]
    _, block = np.unique(np.stack([rows.run[mine], rows.t[mine] // BLOCK]), axis=1, return_inverse=True)
    p = p_value(np.bincount(block.ravel(), weights=gain).astype(float))
    size, left = (float(np.sqrt(np.mean(each[mine] ** 2))) for each in (before[1], after[1]))
    removed = np.sqrt(max(size**2 - left**2, 0.0)) / friction_sizes(straight.problem, straight.best)[j]
    justified = p * tried < BY_CHANCE and left < (1.0 - REDUCED) * size and removed > MATTERS
    return Trial(joint=j + 1, straight=size, curve=left, p=p, stays=bool(justified))


def _speed(rows: Equations, j: int) -> Array:
    """(rows,) rad/s (m/s) of joint j (from 0), as its columns of viscous friction have it."""
    viscous = [k for k, name in enumerate(rows.names) if name.startswith(f"joint{j + 1}.viscous")]
    return np.abs(rows.columns[:, viscous].sum(axis=1))


def _held_out_residual(one: Solved) -> tuple[Equations, Array]:
    """Held-out rows and their residual; without held-out recordings the late part by a fit of the early one."""
    problem = one.problem
    if problem.held is not None:
        return problem.held, _residual(problem, problem.held, one.best)
    ends = np.array([motion.t[-1] for motion in problem.motions])
    early = problem.rows.t < (SPLIT * ends)[problem.rows.run]
    late = problem.judged.of(problem.judged.t > SPLIT * ends[problem.judged.run])
    solve: Callable[[Equations], Fit] = one.solve
    return late, _residual(problem, late, solve(problem.rows.of(early)))


def _residual(problem: Problem, rows: Equations, fit: Fit) -> Array:
    return np.asarray(rows.torque - problem.given(rows) - rows.columns[:, problem.columns] @ fit.values)
