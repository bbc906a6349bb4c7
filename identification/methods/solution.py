"""Least squares of one problem, with all that a result needs of it: values, uncertainty, weak directions, refits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from identification.regression.equations import Equations, shown_rows
from identification.regression.friction_shape import cross_validated_scale, smoothness
from identification.regression.least_squares import Fit, Joints, Method, joint_noise, least_squares, regularised
from identification.regression.model_parameters import model_values
from identification.regression.physical_arm import physical_values, with_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty, fit_uncertainty
from identification.regression.weak_directions import regularised_to_model

STEPS = 8
"""Gauss-Newton steps of an arm with effects, at most."""
CONVERGED = 0.1
"""A step of fewer standard deviations is the last."""
SHORTEST = 1 / 16
"""Smallest share of a step in the line search."""
LEAST_FRICTION = 0.02
"""Of the rms torque of a joint: the size of friction that smoothness is measured by, at least."""


@dataclass(frozen=True)
class Solution:
    """A fit of ``problem`` and its uncertainty; ``held``: weak directions; ``solve`` refits part of the rows.

    scale: of the smoothness of friction curves, as a share of the joints' friction; None without a curve.
    """

    problem: Problem
    best: Fit
    uncertainty: FitUncertainty
    held: int
    solve: Callable[[Equations], Fit]
    scale: float | None = None

    def residual(self, rows: Equations, fit: Fit | None = None) -> Array:
        """(rows,) N m (N): torques of rows of the problem less those of the best fit, or of another one."""
        values = (fit or self.best).values
        return np.asarray(
            rows.torque - self.problem.given_torque(rows) - rows.columns[:, self.problem.columns] @ values
        )


def solve(problem: Problem, method: Method, progress: Progress) -> Solution:
    """The least-squares fit of a problem; with effects by Gauss-Newton steps, with friction curves regularised."""
    prior, scale = _prior(problem, method)

    def fitted(rows: Equations) -> tuple[Fit, Array | None]:
        columns, torque = rows.columns[:, problem.columns], rows.torque - problem.given_torque(rows)
        return regularised(columns, torque, rows.joint, method, prior)

    arm = problem.arm
    values = model_values(arm if problem.start is None else problem.start, problem.friction)
    before, held = None, 0
    for number in range(STEPS if arm.effects else 1):
        progress(Step("least squares", number, None if arm.effects else 1))
        best, weighed = fitted(problem.rows)
        progress("uncertainty")
        uncertainty = fit_uncertainty(problem.rows.columns[:, problem.columns], problem.rows, best, prior=weighed)
        if method != "ols":  # which is the textbook's
            best, held = regularised_to_model(problem, best, uncertainty.information)
        if not arm.effects or converged(before, best, uncertainty):
            break
        if number + 1 == STEPS:  # rows around the values would be others than those of the fit
            _warn_once(
                problem,
                f"the effects did not converge in {STEPS} steps; is one of them far from its value in the model?",
            )
            break
        before = best.values
        values = _towards(problem, values, physical_values(problem, best, uncertainty.of_rows), best)
        problem, known = problem.around(with_values(problem, values)), len(problem.excited)
        if len(problem.excited) > known:
            prior, scale = _prior(problem, method)
    return Solution(problem, best, uncertainty, held, lambda rows: fitted(rows)[0], scale)


def fitted_arm(fit: Solution) -> Arm:
    """The physically consistent arm nearest to a fit."""
    return with_values(fit.problem, physical_values(fit.problem, fit.best, fit.uncertainty.of_rows))


def converged(before: Array | None, fit: Fit, uncertainty: FitUncertainty) -> bool:
    """Whether no value has moved by more than a trace of its deviation; never where others were fitted ``before``."""
    if before is None or len(before) != len(fit.values):
        return False
    return bool(np.all(np.abs(fit.values - before) < CONVERGED * uncertainty.std))


def _prior(problem: Problem, method: Method) -> tuple[tuple[Array, Joints, Array] | None, float | None]:
    """What ``regularised`` takes for the arm's friction curves, and its cross-validated scale; None without a curve."""
    if all(joint.friction_curve is None for joint in problem.arm.joints):
        return None, None
    rows = problem.rows
    columns, torque = rows.columns[:, problem.columns], rows.torque - problem.given_torque(rows)
    free = least_squares(columns, torque, rows.joint, method)
    smooth = smoothness(problem, friction_sizes(problem, free))
    if smooth is None:
        return None, None
    noise = joint_noise(free.residual, rows.joint, joints=len(problem.arm))
    best, weighed = regularised(columns, torque, rows.joint, method, (smooth.rows, smooth.joint, noise))
    scale = cross_validated_scale(fit_uncertainty(columns, rows, best, prior=weighed), best, smooth)
    return (smooth.rows / scale, smooth.joint, noise), scale


def friction_sizes(problem: Problem, fit: Fit) -> Array:
    """(n,) N m (N): the joints' Coulomb friction by a fit, at least LEAST_FRICTION of their torques."""
    names, rows = [problem.base.names[k] for k in problem.columns], problem.rows
    sizes = []
    for j in range(len(problem.arm)):
        torque = rows.torque[rows.joint == j]
        least = LEAST_FRICTION * float(np.sqrt(np.mean(torque**2))) if len(torque) else 1.0
        level = [abs(fit.values[k]) for k, name in enumerate(names) if name.startswith(f"joint{j + 1}.coulomb")]
        sizes.append(max([least, 1e-12, *level]))
    return np.array(sizes)


def _towards(problem: Problem, now: Array, wanted: Array, fit: Fit) -> Array:
    """The point between parameters ``now`` (p,) and ``wanted`` up to which the fit to the torques improves.

    Found by a line search that halves the step.

    Both are consistent arms, and so is all that lies between.
    """

    def cost(values: Array) -> float:
        shown = shown_rows(with_values(problem, values), problem.arm, problem.motions)
        return float(np.sum((fit.weight * (problem.rows.torque - shown)) ** 2))

    least, length = cost(now), 1.0
    while cost(now + length * (wanted - now)) > least and length > SHORTEST:
        length /= 2
    return now + length * (wanted - now)


def _warn_once(problem: Problem, warning: str) -> None:
    """Adds a warning to those of the problem, which the trials of further terms share."""
    if warning not in problem.warnings:
        problem.warnings.append(warning)
