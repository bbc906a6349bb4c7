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
from identification.methods.friction_trial import held_out_residual, residual_of
from identification.methods.solved import Solved, solved
from identification.preprocessing.signals import (
    Motion,
    equation_rows,
    equation_weight,
    parallel_filter,
    with_reversals,
)
from identification.regression.equations import Equations
from identification.regression.least_squares import Method, joint_noise
from identification.regression.problem import Problem
from identification.ripples.search import BY_CHANCE
from identification.selection import BLOCK_SECONDS, p_value, scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance

CLEARLY = 4.0
"""Standard deviations from zero of what a sharp sign has more, for it to be tried."""
SHARPEST = 0.2
"""Of the model's velocity: a smaller one changes nothing at speeds at which a joint is known to slide."""
LEAST = 0.3
"""Of what a sharp sign has more: less leaves the velocity as it is."""
REDUCED = 0.01
"""Of the rms error of a joint on held-out rows: what a sharper sign must take away to stay."""


@dataclass(frozen=True, kw_only=True)
class Sharper:
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


def with_sharper_sign(problem: Problem, method: Method, progress: Progress) -> tuple[Problem, list[Sharper]]:
    """The problem with the sign velocities that the held-out rows justify, and all that were tried."""
    progress("sign of the friction")
    bare = solved(problem, method, progress)
    wanted = sharper_shown(bare)
    if not wanted:
        return problem, []
    tried = _judged(wanted, bare, solved(with_sign_velocities(problem, wanted), method, progress))
    stay = {one.joint - 1: one.found for one in tried if one.stays}
    return (with_sign_velocities(problem, stay) if stay else problem), tried


def sharper_shown(found: Solved) -> dict[int, float]:
    """Joint (from 0) -> sign velocity, rad/s (m/s), where the fitted rows show a sharper sign than the model has."""
    problem = found.problem
    rows, residual = problem.rows, residual_of(problem, problem.rows, found.best)
    noise = joint_noise(residual, rows.joint)[rows.joint]
    levels = _levels(found)
    if not levels:
        return {}
    lacking = np.column_stack([level * _more(problem.arm, problem.motions, j, 0.0) for j, level in levels.items()])
    arm = rows.columns[:, problem.columns] / noise[:, None]
    # what the arm's own columns leave of both sides (Frisch & Waugh, Econometrica 1, 1933)
    both = np.column_stack([lacking / noise[:, None], residual / noise])
    both = both - arm @ scaled_lstsq(arm, both)
    columns, left = both[:, :-1], both[:, -1]
    share = scaled_lstsq(columns, left)
    _, block = np.unique(np.stack([rows.run, rows.t // BLOCK_SECONDS]), axis=1, return_inverse=True)
    std = np.sqrt(np.diag(cluster_covariance(columns, [left - columns @ share], block.ravel())))
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


def _levels(found: Solved) -> dict[int, float]:
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


def _judged(wanted: Mapping[int, float], without: Solved, with_it: Solved) -> list[Sharper]:
    """Both fits on the held-out rows on which a joint slides."""
    (rows, one), (_, other) = held_out_residual(without), held_out_residual(with_it)
    tried = []
    for j, velocity in wanted.items():
        mine = (rows.joint == j) & (True if rows.sliding is None else rows.sliding)
        before, after = (float(np.sqrt(np.mean(each[mine] ** 2))) if mine.any() else 0.0 for each in (one, other))
        _, block = np.unique(np.stack([rows.run[mine], rows.t[mine] // BLOCK_SECONDS]), axis=1, return_inverse=True)
        gains = np.bincount(block.ravel(), weights=(one**2 - other**2)[mine]).astype(float)
        stays = bool(mine.any() and p_value(gains) * len(wanted) < BY_CHANCE and after < (1.0 - REDUCED) * before)
        tried.append(
            Sharper(
                joint=j + 1,
                model=without.problem.arm.joints[j].sign_velocity,
                found=velocity,
                before=before,
                after=after,
                stays=stays,
            )
        )
    return tried
