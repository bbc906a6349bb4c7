"""Combinations of base parameters that these runs hardly show keep the model's values if not refuted.

Least squares gives such a direction a value all the same: the noise's. On the runs that were fitted it does no harm,
and on another motion, where the two nearly equal columns differ (a spring and gravity, of a joint that hardly moved),
it ruins the prediction.

In units of what the model's own numbers amount to, the eigenvectors of the information are directions that the data
knows independently of each other. One is held if its deviation is above WEAK of that size and the model's value lies
within SURE deviations; all others keep the least-squares value to the last digit. A pretest estimator (Judge & Bock,
1978), rather than a ridge, which would draw on the strong directions too.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from identification.regression.identifiability import LEAST
from identification.regression.least_squares import Fit
from identification.regression.model_parameters import model_values
from identification.regression.problem import Problem
from identification.result import unit_of

WEAK = 0.1
"""Of the model's size."""
SURE = 3.0
"""Standard deviations, including the correlation of the residual."""


def regularised_to_model(problem: Problem, fit: Fit, information: Array) -> tuple[Fit, int]:
    """The fit of the excited base parameters with its weak directions at the model's values, and how many these are.

    information (b, b): inverse covariance of the fitted values, as ``FitUncertainty`` has it.
    """
    model = problem.base.grouping[problem.excited] @ model_values(problem.arm, problem.friction)
    size = _sizes(problem, information)
    known, directions = np.linalg.eigh(information * size[:, None] * size)
    deviation = 1 / np.sqrt(np.maximum(known, 1e-300))
    off = directions.T @ ((fit.values - model) / size)
    held = (deviation > WEAK) & (np.abs(off) < SURE * deviation)
    values = fit.values - size * (directions[:, held] @ off[held])
    residual = fit.residual + problem.rows.columns[:, problem.columns] @ (fit.values - values)
    return Fit(values, fit.weight, residual, fit.scaled), int(held.sum())


def held_note(held: int, directions: int) -> list[str]:
    """The note about it in the result."""
    if not held:
        return []
    return [
        f"{held} of {directions} directions of the base parameters have a std above {WEAK:.0%} of the model's values, "
        "and do not contradict these: they keep the model's values (method ols estimates all)"
    ]


def _sizes(problem: Problem, information: Array) -> Array:
    """(b,) sizes of the excited base parameters: the sum of the magnitudes that the model adds up in each.

    Each is at least LEAST of the largest of its unit; for a unit of which the model knows nothing, and for friction
    curves, large enough to hold nothing.
    """
    size = np.abs(problem.base.grouping[problem.excited]) @ np.abs(model_values(problem.arm, problem.friction))
    units = np.array([unit_of(problem.base.names[column], problem.arm) for column in problem.columns])
    for unit in set(units):
        of_unit = units == unit
        size[of_unit] = np.maximum(size[of_unit], LEAST * size[of_unit].max())
    # friction curves are regularised already
    unknown = (size == 0) | np.array([".curve" in problem.base.names[column] for column in problem.columns])
    size[unknown] = 1e3 / np.sqrt(np.maximum(np.diag(information)[unknown], 1e-300))
    return np.asarray(size)
