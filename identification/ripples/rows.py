"""The rows in which ripples are looked for: those of a regression in a wider band, with its own columns taken out.

A wave takes part in no column of the arm that is smooth in the angle, and still a few of its cycles look like weight or
friction. So a wave's columns are what the arm's own leave of them (Frisch & Waugh, Econometrica 1, 1933), fitted on the
fitted rows; on held-out rows the same combination is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from identification.conclusion.predictions import SPLIT
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter, spared
from identification.regression.equations import Equations, equations, with_effects
from identification.regression.least_squares import joint_noise
from identification.regression.problem import Problem
from identification.ripples.scan import wide
from identification.selection import scaled_lstsq

DETERMINED = 1e-9
"""Singular value of scaled columns below which a direction of the arm is not determined in the wider band."""


@dataclass(frozen=True)
class Side:
    """Rows of the fitted or of the held-out motions: columns (k, b) of the arm, y (k,) torques, both over the noise.

    noise (J,) N m (N) of each joint; kept (r,) True for the rows, of all that the motions have, that are of this side.
    """

    motions: Sequence[Motion]
    equations: Equations
    columns: Array
    y: Array
    noise: Array
    kept: NDArray[np.bool_]

    @cached_property
    def block(self) -> NDArray[np.intp]:
        """(k,) number of each row's block of time, from 0."""
        return self.equations.blocks()

    def whitened(self, arm: Arm, joint: int, torques: Sequence[Array]) -> Array:
        """(k, c) columns over the noise of ``torques`` (m, c) at the drive of a joint (from 0), one per motion."""
        turns, parts = arm.coupling_matrix[joint], []
        for motion, torque in zip(self.motions, torques):
            joints, row = np.nonzero(equation_rows(motion)[1].T)
            part = np.zeros((len(joints), torque.shape[1]))
            for j in np.flatnonzero(turns):
                of_joint = joints == j
                filtered = parallel_filter(motion, turns[j] * torque * equation_weight(motion)[:, j, None])
                part[of_joint] = filtered[row[of_joint]]
            parts.append(part)
        return np.asarray(np.concatenate(parts)[self.kept] / self.noise[self.equations.joint, None])


@dataclass(frozen=True)
class WideRows:
    """Fitted and held-out rows in the wider band; arm: the model of the regression."""

    arm: Arm
    fit: Side
    held_out: Side

    @cached_property
    def _triangle(self) -> tuple[Array, Array]:
        """(b, k) pseudo-inverse of the fitted columns, by their Gram matrix; and the scale (b,) of these."""
        scale = np.linalg.norm(self.fit.columns, axis=0)
        scale[scale == 0.0] = 1.0
        x = self.fit.columns / scale
        return np.asarray(np.linalg.pinv(x.T @ x, rcond=DETERMINED, hermitian=True)), scale

    def without_other_columns(self, fitted: Array, held_out: Array) -> tuple[Array, Array]:
        """Columns (k, c) of both sides without what the arm's own explain of the fitted ones."""
        inverse, scale = self._triangle
        values = (inverse @ ((self.fit.columns / scale).T @ fitted)) / scale[:, None]
        return fitted - self.fit.columns @ values, held_out - self.held_out.columns @ values

    @cached_property
    def residual(self) -> tuple[Array, Array]:
        """(k,) each: what the arm's own columns leave of the torques of both sides, over the noise."""
        one, other = self.without_other_columns(self.fit.y[:, None], self.held_out.y[:, None])
        return one[:, 0], other[:, 0]


def wide_rows(problem: Problem, near: Arm) -> WideRows:
    """The rows of a problem in the band of ripples, reversals left out; without held-out recordings a split in time.

    near: the fitted arm, at whose values effects are linearised.
    """
    motions = spared([wide(replace(motion, for_judging=False)) for motion in problem.motions])
    found, y = _equations(problem, near, motions)
    columns = found.columns[:, problem.columns]
    noise = np.ones(len(problem.arm))
    levels = joint_noise(y - columns @ scaled_lstsq(columns, y), found.joint)
    noise[: len(levels)] = levels
    if problem.held_motions:
        other = spared([wide(replace(motion, for_judging=False)) for motion in problem.held_motions])
        parts = [(motions, found, y), (other, *_equations(problem, near, other))]
        return WideRows(problem.arm, *(_side(problem, *part, noise, np.ones(len(part[2]), bool)) for part in parts))
    early = found.t < (SPLIT * np.array([motion.t[-1] for motion in motions]))[found.run]
    return WideRows(problem.arm, *(_side(problem, motions, found, y, noise, mine) for mine in (early, ~early)))


def _equations(problem: Problem, near: Arm, motions: Sequence[Motion]) -> tuple[Equations, Array]:
    """The rows, and the torque (k,) N m (N) that the excited base parameters are to explain."""
    found = equations(problem.arm, motions, problem.friction, problem.base)
    found = with_effects(found, near, problem.arm, motions, problem.friction, problem.base)
    return found, found.torque - problem.given_torque(found)


def _side(
    problem: Problem, motions: Sequence[Motion], found: Equations, y: Array, noise: Array, kept: NDArray[np.bool_]
) -> Side:
    rows, weight = found.of(kept), 1.0 / noise[found.joint[kept]]
    return Side(motions, rows, rows.columns[:, problem.columns] * weight[:, None], y[kept] * weight, noise, kept)
