"""Orders of the motor angle at which a residual is strongest: of sixty per joint, ripples are candidates at these."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.residual.run import passed
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset

STRONGEST = 5
"""Orders kept for each way in which a ripple acts: as a torque, by the acceleration of the link, by the load it lifts.
"""
FEW = 4
"""Effects of so few orders are candidates at all of them."""


def order_of(candidate: Candidate) -> int | None:
    """The order of a ripple over motor angle with many possible orders; None for all other candidates."""
    for parameter in candidate.definition.parameters:
        if parameter.whole and parameter.name in dict(candidate.shape) and np.ptp(parameter.typical) > FEW:
            return round(dict(candidate.shape)[parameter.name])
    return None


def detectable_orders(side: Dataset, residual: Array, arm: Arm, joint: int, highest: int) -> set[int]:
    """The strongest orders 1..highest at a joint in ``residual`` (n * rows,), whitened.

    The gain of a column w sin(k motor + phase) is |sum r w exp(i k motor)|^2 / (sum w^2 / 2), with w the factor of the
    sine in the effect's law, attenuated by the filters.
    """
    ratio = arm.joints[joint - 1].ratio
    over, v = 1.0 / side.at_joint("deviation", joint), side.at_joint("v", joint)
    weights = np.stack([over, over * v**2, over * side.at_joint("rigid", joint)], axis=1)
    weighted = residual[side.of(joint)][:, None] * weights
    turn = np.exp(1j * ratio * side.at_joint("q", joint))
    power, wave = np.zeros((highest + 1, weights.shape[1])), np.ones_like(turn)
    for order in range(1, highest + 1):
        wave = wave * turn
        through = passed(order * ratio * np.abs(v) / (2 * np.pi))[:, None]
        size = np.sum((weights * through) ** 2, axis=0)
        power[order] = np.abs(wave @ (weighted * through)) ** 2 / np.maximum(size, 1e-300)
    return {int(order) for column in power.T for order in np.argsort(column)[-STRONGEST:] if order > 0}
