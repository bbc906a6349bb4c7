"""Share of a residual that is predictable structure: from position, velocity and load, whatever the cause may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents.structure.shared_bases import variables
from diagnosis.selection.design import Dataset

FROM = ("position", "velocity", "load torque")
KNOTS = 12
"""Knots of the function of one variable: enough for two cycles over its range."""
RIDGE = 1e-3
"""Ridge penalty relative to the mean Gram diagonal; shrinks knots without data to zero."""


def predictable(fit: Dataset, held_out: Dataset, fit_residual: Array, held_out_residual: Array, arm: Arm) -> Array:
    """(n,) share of the variance of each joint's held-out residual that smooth functions of its ``FROM`` predict.

    Their sum is fitted to the other recordings and evaluated within the range of these: 0 for noise. Residuals
    (n * rows,) are whitened, in the layout of ``Dataset``.
    """
    shares = np.zeros(len(arm))
    for joint in range(1, len(arm) + 1):
        values_of = [dict(variables(side, arm, joint)) for side in (fit, held_out)]
        knots = [np.unique(np.quantile(values_of[0][name], np.linspace(0.0, 1.0, KNOTS))) for name in FROM]
        if any(len(places) < KNOTS for places in knots):
            continue  # standstill
        x, x_held = (_hats(values, knots, side, joint) for values, side in zip(values_of, (fit, held_out)))
        inside = np.all([(values_of[1][n] >= k[0]) & (values_of[1][n] <= k[-1]) for n, k in zip(FROM, knots)], axis=0)
        gram = x.T @ x
        ridge = RIDGE * np.trace(gram) / len(gram)
        c = np.linalg.solve(gram + ridge * np.eye(len(gram)), x.T @ fit_residual[fit.of(joint)])
        y = held_out_residual[held_out.of(joint)][inside]
        if len(y):
            shares[joint - 1] = max(0.0, 1.0 - float(np.sum((y - x_held[inside] @ c) ** 2) / np.sum(y**2)))
    return shares


def _hats(values: Mapping[str, Array], knots: Sequence[Array], side: Dataset, joint: int) -> Array:
    """(rows, len(FROM) * KNOTS) hat functions of every variable over the deviation of each row."""
    over = 1.0 / side.at_joint("deviation", joint)
    hats = [np.interp(values[name], at, unit) * over for name, at in zip(FROM, knots) for unit in np.eye(len(at))]
    return np.stack(hats, axis=1)
