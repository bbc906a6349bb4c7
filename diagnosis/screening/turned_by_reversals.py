"""How far the friction of a joint that reverses may turn a joint between two rows: motion, and no missed counts."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import drive_mass_matrix
from daq.recording import Recording
from diagnosis.residual.noise.encoder_step import encoder_step

ROWS = 2
"""Rows before and after an instant over which the direction of motion is read."""
MOVES_BY = 2.0
"""Steps of the encoder that a joint must turn within ``ROWS``, so that its direction is known."""
SLOW = 0.02
"""Share of the fastest such turn (99 % quantile) that an angle without steps must turn instead."""


def turned_by_reversals(recording: Recording, arm: Arm, joint: int, row: int) -> float:
    """rad (m): by how much a joint (from 0) may turn more between a row and the one before where joints reverse.

    Coulomb friction F of a joint that reverses changes by 2 F. Until its drive follows, which takes some milliseconds,
    the difference accelerates all joints, by M^-1 2 F; within dt that is M^-1 2 F dt^2. 0 where no joint reverses.
    """
    friction = [max(abs(one) for one in drive.rest_friction) for drive in arm.joints]
    torque = np.array([2.0 * own if _reverses(q, row) else 0.0 for own, q in zip(friction, recording.q.T)])
    if not torque.any():
        return 0.0
    acceleration: Array = np.abs(np.linalg.pinv(drive_mass_matrix(arm, recording.q[row : row + 1])[0]))[joint] @ torque
    return float(acceleration) * recording.dt**2


def _reverses(q: Array, row: int) -> bool:
    """Whether an angle (m,) changes its direction at a row, in turns that its encoder shows."""
    if row <= ROWS or row + ROWS >= len(q):
        return False
    before, after = q[row - 1] - q[row - 1 - ROWS], q[row + ROWS] - q[row]
    least = MOVES_BY * encoder_step(q) or SLOW * float(np.quantile(np.abs(q[ROWS:] - q[:-ROWS]), 0.99))
    return bool(before * after < 0.0 and min(abs(before), abs(after)) >= least > 0.0)
