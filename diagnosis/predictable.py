"""How much of a residual is structure still: the share of it that position, velocity and load predict, whatever the cause may be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from diagnosis.library import Side
from diagnosis.shapes import variables

Array = NDArray[np.float64]

FROM = ("position", "velocity", "load torque")
KNOTS = 12
RIDGE = 1e-3
"""Of the rows a knot has on average: keeps knots that no row comes near at nothing."""


def predictable(fit: Side, held_out: Side, fitted: Array, held: Array, arm: Arm) -> Array:
    """(n,) share of the variance of every joint's held-out residual that a sum of smooth functions of its ``FROM``, fitted to the other
    recordings, predicts: 0 for noise. fitted, held (n * rows,): whitened residuals in the layout of ``Side``."""
    shares = np.zeros(len(arm))
    for joint in range(1, len(arm) + 1):
        columns = _columns(fit, held_out, arm, joint)
        if columns is None:
            continue
        x, x_held = columns
        y, y_held = fitted[fit.of(joint)], held[held_out.of(joint)]
        gram = x.T @ x
        ridge = RIDGE * np.trace(gram) / len(gram)
        predicted = x_held @ np.linalg.solve(gram + ridge * np.eye(len(gram)), x.T @ y)
        shares[joint - 1] = max(0.0, 1.0 - float(np.sum((y_held - predicted) ** 2) / np.sum(y_held**2)))
    return shares


def _columns(fit: Side, held_out: Side, arm: Arm, joint: int) -> tuple[Array, Array] | None:
    """Hat functions of every variable over the deviation of each row, on both sides; None of a joint that stood."""
    sides = []
    known = [dict(variables(side, arm, joint)) for side in (fit, held_out)]
    for side, values in zip((fit, held_out), known):
        over = 1.0 / np.concatenate([run.deviation[:, joint - 1] for run in side.runs])
        hats = []
        for name in FROM:
            knots = np.unique(np.quantile(known[0][name], np.linspace(0.0, 1.0, KNOTS)))
            if len(knots) < KNOTS:
                return None
            inside = (values[name] >= knots[0]) & (values[name] <= knots[-1])
            hats += [np.interp(values[name], knots, one) * inside * over for one in np.eye(len(knots))]
        sides.append(np.stack(hats, axis=1))
    return sides[0], sides[1]
