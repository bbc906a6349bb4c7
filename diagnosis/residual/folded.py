"""What sampling may have put into currents unseen, where rows come at a multiple of the rate of setpoints."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.residual.expected_current import COLUMN_BAND, COMPARE_BAND, low_pass
from identification.preprocessing import UNSEEN, folded_along, rows_a_setpoint, seen_rows

FEW_ROWS, FOLDED = 10, 0.5
"""Rows per setpoint, and share of the noise: of more rows, what sampling folds counts from that share on."""


def rows_per_setpoint(arm: Arm, i: Array, a: Array, rate: float) -> int:
    """Of currents i (k, n) A and accelerations a (k, n), uniform at ``rate`` Hz; 0 where no multiple is known or seen.

    Stated by the controller of the model; without one, what the currents show.
    """
    if arm.controller is not None:
        return rows_a_setpoint(arm, 1 / rate)
    return seen_rows(i - low_pass(i, COMPARE_BAND, rate), low_pass(a, COLUMN_BAND, rate), rate)


def folded_currents(
    arm: Arm, samples: tuple[Array, Array, Array], rows: int, keep: slice, a: Array, noise: Array
) -> Array:
    """(m, n) A: one std of what sampling may have put into currents unseen, of joints where that matters.

    samples: t (k,) s, q (k, n) rad of the motors, i (k, n) A; ``rows`` per setpoint; keep: the m of the k rows that
    are compared; a (m, n): the acceleration in the band of comparison; noise (n,) A. Of two stated rows per setpoint,
    all of the acceleration times 1 kg m2 (kg). From many rows on, the line that folds is far below what those that are
    seen allow.
    """
    (t, q, i), constant = samples, arm.joint_array("drive_constant")
    if rows == UNSEEN and arm.controller is not None:
        return a / constant
    torque = folded_along(arm, t, q, i * constant, rows)
    if torque is None:
        return np.zeros_like(a)
    folded = torque[keep] / constant
    return np.asarray(folded * ((rows <= FEW_ROWS) | (np.sqrt(np.mean(folded**2, axis=0)) > FOLDED * noise)))
