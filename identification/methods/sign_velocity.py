"""Whether friction changes its sign more sharply than the model says, decided on held-out rows.

The sign of a speed v is v / sqrt(v^2 + w^2) in a model (``sign_velocity`` w). At ten times w that lacks 0.5 % of the
Coulomb friction, at three times 5 %; with w = 10 mrad/s, the default, up to 0.1 rad/s. Where the friction of the arm
turns within a few mrad/s, that much is missing in a fit on rows at which the joint slides, and Coulomb and viscous
friction make up for it, beyond their stated deviations.

w is estimated joint by joint beside all other parameters: the column is what friction with a sharp sign has more. Only
a smaller one is looked for: friction that grows beyond is a matter of its curve over speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from identification.methods.added_columns import added_coefficients
from identification.methods.held_out import Comparison, held_out_residuals
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

CLEARLY = 4.0
"""Standard deviations from zero of what a sharp sign has more, for it to be tried."""
SHARPEST = 0.2
"""Of the model's velocity: a smaller one changes nothing at speeds at which a joint is known to slide."""
LEAST = 0.3
"""Of what a sharp sign has more: less leaves the velocity as it is."""
REDUCED = 0.01
"""Of the rms error of a joint on held-out rows: what a sharper sign must take away to stay."""


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
    wanted = sign_velocities_shown(bare)
    if not wanted:
        return problem, []
    tried = _judged(wanted, bare, solve(with_sign_velocities(problem, wanted), method, progress))
    stay = {one.joint - 1: one.found for one in tried if one.stays}
    return (with_sign_velocities(problem, stay) if stay else problem), tried


def sign_velocities_shown(found: Solution) -> dict[int, float]:
    """Joint (from 0) -> sign velocity, rad/s (m/s), where the fitted rows show a sharper sign than the model has."""
    problem, levels = found.problem, _levels(found)
    if not levels:
        return {}
    lacking = [level * _more(problem.arm, problem.motions, j, 0.0) for j, level in levels.items()]
    share, std = added_coefficients(found, np.column_stack(lacking))
    # of the tail w^2 / (2 v^2) a share s is missing: w^2 (1 - s) is left
    return {
        j: problem.arm.joints[j].sign_velocity * float(np.sqrt(max(1.0 - one, SHARPEST**2)))
        for j, one, of_one in zip(levels, share, std, strict=True)
        if one > max(LEAST, CLEARLY * of_one) and of_one > 0.0
    }


def with_sign_velocities(problem: Problem, wanted: Mapping[int, float]) -> Problem:
    """The problem with these sign velocities (rad/s, m/s) at joints (from 0)."""
    joints = list(problem.arm.joints)
    for j, velocity in wanted.items():
        joints[j] = replace(joints[j], sign_velocity=velocity)

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
        arm=replace(problem.arm, joints=tuple(joints)),
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
        mine = [v for name, v in zip(names, found.best.values) if name.startswith(f"joint{j + 1}.coulomb")]
        more = joint.friction_curve is not None or any(term.joint == j + 1 for term in problem.arm.effects)
        if not more and mine and np.mean(mine) > 0.0:
            levels[j] = float(np.mean(mine))
    return levels


def _judged(wanted: Mapping[int, float], without: Solution, with_it: Solution) -> list[SignVelocity]:
    """Both fits on the held-out rows on which a joint slides."""
    residuals, tried = held_out_residuals(without, with_it), []
    for j, velocity in wanted.items():
        one = residuals.on(residuals.rows.joint == j) or Comparison(before=0.0, after=0.0, p=1.0)
        tried.append(
            SignVelocity(
                joint=j + 1,
                model=without.problem.arm.joints[j].sign_velocity,
                found=velocity,
                before=one.before,
                after=one.after,
                stays=one.p * len(wanted) < BY_CHANCE and one.after < (1.0 - REDUCED) * one.before,
            )
        )
    return tried
