"""What the servos of a run were asked, from its recorded demands.

A recording may hold what the host planned, at every row, or what the servos made of it: straight lines between
setpoints. A plan that is taken for the lines is too lively by what the lines cut off its corners, (pi f T)^2 / 3 of its
acceleration at f Hz: 1 % at 2 Hz for setpoints every T = 28 ms, and in a closed loop that simulates it, 1 % of the
inertias.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.simulation import Demand, Sampled
from daq.recording import Recording
from identification.preprocessing.setpoints import stated_period

BENT = 1e-9  # rad or m: largest second difference of a straight line
FEW = 3  # rows per setpoint: with fewer, lines and a plan cannot be distinguished
MOSTLY = 0.5


def demand_of_run(recording: Recording, arm: Arm) -> Demand:
    """t (k,) s from the start of the run -> demanded positions (k, n).

    ``Sampled`` where the servos tracked exactly these, and not straight lines between setpoints taken of them.
    """
    demands, t = recording.qref, recording.t - recording.t[0]
    assert demands is not None
    samples = [(t[ok], column[ok]) for column in demands.T for ok in [np.isfinite(column)]]

    def demand(times: Array) -> Array:
        return np.column_stack([np.interp(times, stamps, column) for stamps, column in samples])

    return Sampled(demand) if tracked_as_recorded(recording, arm) else demand


def tracked_as_recorded(recording: Recording, arm: Arm) -> bool:
    """Whether the recorded demands are what the servos tracked, instead of the plan that a host sent setpoints of."""
    assert recording.qref is not None
    return stated_period(arm) < FEW * recording.dt or not _planned(recording.qref)


def _planned(demands: Array) -> bool:
    """Whether demands (n, J) bend at most rows in which they move."""
    first = np.diff(demands, axis=0)
    bend, moves = np.abs(np.diff(first, axis=0)), np.abs(first[1:]) > BENT
    return bool(moves.any()) and float(np.mean(bend[moves] > BENT)) > MOSTLY
