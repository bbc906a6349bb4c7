"""Columns added to a fit: their coefficients conditional on the arm's own, without fitting all of it again."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from identification.methods.solution import Solution
from identification.regression.least_squares import joint_noise
from identification.selection import scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance


def added_coefficients(found: Solution, columns: Array) -> tuple[Array, Array]:
    """Coefficients (k,) of ``columns`` (rows, k), N m (N) on the fitted rows, and their std by blocks of a second.

    Residual and columns are weighted by the joints' noise; what the arm's own columns explain of both is projected out
    (Frisch & Waugh, Econometrica 1, 1933).
    """
    rows, residual = found.problem.rows, found.residual(found.problem.rows)
    noise = joint_noise(residual, rows.joint)[rows.joint]
    arm = rows.columns[:, found.problem.columns] / noise[:, None]
    both = np.column_stack([columns / noise[:, None], residual / noise])
    both = both - arm @ scaled_lstsq(arm, both)
    x, y = both[:, :-1], both[:, -1]
    coefficients = scaled_lstsq(x, y)
    covariance = cluster_covariance(x, [y - x @ coefficients], rows.blocks())
    return coefficients, np.sqrt(np.diag(covariance))
