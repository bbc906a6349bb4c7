"""How well a motion shows an arm's parameters: the two criteria of design, of many motions at a time.

d            determinant of the information matrix of the base parameters, rows weighted by each joint's torque limit:
             smallest volume of the confidence ellipsoid
condition    condition number of the weighted regressor, columns scaled by the parameters' expected size: no direction
             neglected
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from identification.experiment_design.limits import Limits
from identification.regression.base_parameters import BaseParameters
from identification.regression.model_parameters import model_columns, model_values

Criterion = Literal["d", "condition"]

PRODUCT = 1e-11
"""Smallest over largest eigenvalue of A^T A: above it, rounding changes a singular value by 1e-5."""
HIDDEN = -1e6
"""Larger than any score: a motion that excites more parameters is always better."""
LARGEST_CONDITION = 1e12
"""Condition number from which on double precision does not resolve the least singular value."""


def scores_of(
    arm: Arm,
    base: BaseParameters,
    t: Array,
    motions: tuple[Array, Array, Array],
    limits: Limits,
    criterion: Criterion,
) -> Array:
    """(m,) of m motions q, q', q'' (m, k, n) at the instants ``t`` (k,); larger is better.

    Log determinant of the information, or minus the log of the condition number, of the directions that the motion
    shows; those that it does not show count ``HIDDEN`` each.
    """
    count = len(motions[0])
    q, qd, qdd = (motion.reshape(-1, len(arm)) for motion in motions)
    columns = model_columns(arm, q, qd, qdd, t=np.tile(t, count))[:, :, base.kept]
    torque = np.where(np.isfinite(limits.torque), limits.torque, 1.0)
    # In units of what the model expects each parameter to be, so that a condition number means something.
    expected = np.abs(base.grouping @ model_values(arm))
    size = np.maximum(expected, 0.1 * np.median(expected[expected > 0]) if (expected > 0).any() else 1.0)
    rows = (columns / torque[None, :, None] * size).reshape(count, -1, len(base))
    values = singular_values(rows)
    shown = values > 1e-12 * values[:, :1]
    logs = np.where(shown, np.log(np.maximum(values, 1e-300)), 0.0)
    least = np.where(shown, logs, np.inf).min(axis=1)
    score = 2 * logs.sum(axis=1) if criterion == "d" else least - logs[:, 0]
    return np.where(shown.any(axis=1), score + HIDDEN * (~shown).sum(axis=1), -np.inf)


def singular_values(rows: Array) -> Array:
    """(k, c) of matrices (k, m, c), m >= c, the largest first.

    As roots of the eigenvalues of their products A^T A, a sixtieth of the time of a decomposition of each A; of those
    so ill-conditioned (``PRODUCT``) that the product has lost the least ones, of A itself.
    """
    squares = np.linalg.eigvalsh(np.swapaxes(rows, -1, -2) @ rows)[:, ::-1]
    values = np.sqrt(np.maximum(squares, 0.0))
    lost = squares[:, -1] < PRODUCT * squares[:, 0]
    if lost.any():
        values[lost] = np.linalg.svd(rows[lost], compute_uv=False)
    return np.asarray(values)


def score_in_words(score: float, criterion: Criterion) -> str:
    """A score as it is printed: log det, or the condition number, beyond any number if parameters are hidden."""
    if criterion == "d":
        return f"{score:.1f}"
    return f"{np.exp(-score):.0f}" if -score < np.log(LARGEST_CONDITION) else f"above {LARGEST_CONDITION:.0e}"
