"""Whether friction changes its sign more sharply than the model says, decided on held-out rows.

The sign of a speed v is v / sqrt(v^2 + w^2) in a model (``sign_velocity`` w). At ten times w that lacks 0.5 % of the
Coulomb friction, at three times 5 %; with w = 10 mrad/s, the default, up to 0.1 rad/s. Where the friction of the arm
turns within a few mrad/s, that much is missing in a fit on rows at which the joint slides, and Coulomb and viscous
friction make up for it, beyond their stated deviations.

w is estimated joint by joint beside all other parameters: the column is what friction with a sharp sign has more. That
is linear in w^2 far above w alone, so that the step is repeated around what it found. Only a smaller w is looked for:
friction that grows beyond is a matter of its curve over speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from identification.methods.added_columns import added_coefficients
from identification.methods.held_out import Comparison, HeldOutResiduals, held_out_residuals
from identification.methods.solution import Solution, solve
from identification.preprocessing.signals import (
    Motion,
    equation_rows,
    equation_weight,
    parallel_filter,
    with_reversals,
)
from identification.regression.equations import Equations
from identification.regression.least_squares import Method
from identification.regression.problem import Problem
from identification.ripples.search import BY_CHANCE

SIGNIFICANT_STDS = 4.0
"""Standard deviations from zero of what a sharp sign has more, for it to be tried."""
SHARPEST = 0.2
"""Of the model's velocity: a smaller one changes nothing at speeds at which a joint is known to slide."""
LEAST = 0.3
"""Of what a sharp sign has more: less leaves the velocity as it is."""
STEPS = 5
"""Steps, at most."""
CONVERGED = 0.05
"""A step in which no velocity changes by more than this share of itself is the last."""
REDUCED = 0.01
"""Of the rms error of a joint on held-out rows: what a sharper sign must take away to stay."""
OWN_CHANCE = 0.05
"""Probability by chance of a joint's own gain on held-out rows, at most, where that of all joints together is clear."""


@dataclass(frozen=True, kw_only=True)
class SignVelocity:
    """A smaller ``sign_velocity`` tried at a joint (from 1), rad/s (m/s), beside the model's.

    before, after: rms errors N m (N) on held-out rows, without and with it; ``stays`` in the model, or not.
    """

    joint: int
    model: float
    found: float
    before: float
    after: float
    stays: bool

    def to_json(self) -> dict[str, Any]:
        """As identification.json has it."""
        return asdict(self)


def with_smaller_sign_velocities(
    problem: Problem, method: Method, progress: Progress
) -> tuple[Problem, list[SignVelocity]]:
    """The problem with the sign velocities that the held-out rows justify, and all that were tried."""
    progress("sign of the friction")
    bare = solve(problem, method, progress)
    wanted, sharper = sign_velocities_shown(bare, problem.arm), bare
    tried = wanted
    for _ in range(STEPS if wanted else 0):
        tried, sharper = wanted, solve(with_sign_velocities(problem, wanted), method, progress)
        wanted = sign_velocities_shown(sharper, problem.arm)
        if not wanted or _converged(tried, wanted):
            break
    if not wanted:
        return problem, []
    judged = _judged(tried, bare, sharper)
    stay = {one.joint - 1: one.found for one in judged if one.stays}
    problem, levels = with_sign_velocities(problem, stay) if stay else problem, _levels(bare)
    for one in judged:
        if not one.stays:  # neither is taken as exact
            j = one.joint - 1
            problem = problem.doubting(levels[j] * _more(problem.arm, problem.motions, j, one.found))
    return problem, judged


def sign_velocities_shown(found: Solution, given: Arm) -> dict[int, float]:
    """Joint (from 0) -> sign velocity, rad/s (m/s), where the fitted rows show a sharper sign than ``given`` has.

    found: a fit with the sign velocities of ``given``, or with smaller ones at some joints, from which these go on.
    """
    problem, levels = found.problem, _levels(found)
    if not levels:
        return {}
    lacking = [level * _more(problem.arm, problem.motions, j, 0.0) for j, level in levels.items()]
    share, std = added_coefficients(found, np.column_stack(lacking))
    shown: dict[int, float] = {}
    for j, one, of_one in zip(levels, share, std, strict=True):
        now, largest = problem.arm.joints[j].sign_velocity, given.joints[j].sign_velocity
        if now < largest or (one > max(LEAST, SIGNIFICANT_STDS * of_one) and of_one > 0.0):
            # of the tail w^2 / (2 v^2) a share s is missing: w^2 (1 - s) is left
            velocity = float(np.clip(now * np.sqrt(max(1.0 - one, 0.0)), SHARPEST * largest, largest))
            shown |= {j: velocity} if velocity < largest else {}
    return shown


def _converged(before: Mapping[int, float], after: Mapping[int, float]) -> bool:
    """Whether the same joints have nearly the same velocities."""
    return before.keys() == after.keys() and all(abs(after[j] - w) <= CONVERGED * w for j, w in before.items())


def with_sign_velocities(problem: Problem, wanted: Mapping[int, float]) -> Problem:
    """The problem with these sign velocities (rad/s, m/s) at joints (from 0)."""
    velocities = problem.arm.joint_array("sign_velocity")
    velocities[list(wanted)] = list(wanted.values())

    def sharper(rows: Equations, motions: Sequence[Motion]) -> Equations:
        columns = rows.columns.copy()
        for j, velocity in wanted.items():
            more = _more(problem.arm, motions, j, velocity)
            backwards = _more(problem.arm, motions, j, velocity, squared=True)
            for name, part in (
                (f"joint{j + 1}.coulomb", more),
                (f"joint{j + 1}.coulomb_positive", (more + backwards) / 2),
                (f"joint{j + 1}.coulomb_negative", (more - backwards) / 2),
            ):
                if name in rows.names:
                    columns[:, rows.names.index(name)] += part
        return replace(rows, columns=columns)

    return replace(
        problem,
        arm=problem.arm.with_sign_velocities(velocities),
        rows=sharper(problem.rows, problem.motions),
        judged=sharper(problem.judged, list(map(with_reversals, problem.motions))),
        held=None if problem.held is None else sharper(problem.held, problem.held_motions),
    )


def _more(arm: Arm, motions: Sequence[Motion], j: int, velocity: float, *, squared: bool = False) -> Array:
    """(rows,) what the sign of joint j (from 0) has more with this velocity than with the model's.

    squared: of the square of the sign.
    """
    power, model = 2 if squared else 1, arm.joints[j].sign_velocity
    parts = []
    for motion in motions:
        v = motion.qd[:, j]
        sharp = np.sign(v) if velocity == 0.0 else v / np.hypot(v, velocity)
        more = sharp**power - (v / np.hypot(v, model)) ** power
        filtered = parallel_filter(motion, more * equation_weight(motion)[:, j])
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        parts.append(np.where(joint == j, filtered[row], 0.0))
    return np.concatenate(parts)


def _levels(found: Solution) -> dict[int, float]:
    """Joint (from 0) -> its Coulomb friction, N m (N), where it is estimated, above zero, and all that has its sign."""
    problem = found.problem
    names = [problem.base.names[k] for k in problem.columns]
    levels = {}
    for j, joint in enumerate(problem.arm.joints):
        coulomb = [v for name, v in zip(names, found.best.values) if name.startswith(f"joint{j + 1}.coulomb")]
        more = joint.friction_curve is not None or any(term.joint == j + 1 for term in problem.arm.effects)
        if not more and coulomb and np.mean(coulomb) > 0.0:
            levels[j] = float(np.mean(coulomb))
    return levels


def _judged(wanted: Mapping[int, float], without: Solution, with_it: Solution) -> list[SignVelocity]:
    """Both fits on the held-out rows on which a joint slides.

    That the model's sign is too blunt is one hypothesis about all joints: their gains together must not be by chance.
    """
    residuals = held_out_residuals(without, with_it)
    joint = residuals.rows.joint
    each = {j: residuals.on(joint == j) or Comparison(before=0.0, after=0.0, p=1.0) for j in wanted}
    scale = np.ones(len(without.problem.arm))
    scale[list(each)] = [one.after or 1.0 for one in each.values()]
    relative = HeldOutResiduals(residuals.rows, residuals.without / scale[joint], residuals.with_it / scale[joint])
    together = relative.on(np.isin(joint, list(wanted)))
    clear = together is not None and together.p < BY_CHANCE
    return [
        SignVelocity(
            joint=j + 1,
            model=without.problem.arm.joints[j].sign_velocity,
            found=velocity,
            before=each[j].before,
            after=each[j].after,
            stays=clear and each[j].p < OWN_CHANCE and each[j].after < (1.0 - REDUCED) * each[j].before,
        )
        for j, velocity in wanted.items()
    ]
