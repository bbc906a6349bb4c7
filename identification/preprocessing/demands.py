"""What the servos of a run were asked, from its recorded demands.

A recording may hold what the host planned, at every row, or what the servos made of it: straight lines between
setpoints. Where the first row is at a setpoint, as in simulated recordings, the rows of such lines determine the
setpoints, however far from the rows these are. A plan that is taken for the lines is too lively by what the lines cut
off its corners, (pi f T)^2 / 3 of its acceleration at f Hz: 1 % at 2 Hz for setpoints every T = 28 ms, and in a closed
loop that simulates it, 1 % of the inertias.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from arm_io.types import Array
from arm_model import Arm
from arm_model.simulation import Demand, Sampled
from daq.recording import Recording
from identification.preprocessing.setpoints import stated_period

BENT = 1e-9
"""rad or m: largest second difference of a straight line."""
FEW = 3
"""Rows per setpoint: with fewer, lines and a plan cannot be distinguished."""
MOSTLY = 0.5
"""Share of the moving rows that bend in a plan; straight lines bend at setpoints only."""


def demand_of_run(recording: Recording, arm: Arm) -> Demand:
    """t (k,) s from the start of the run -> demanded positions (k, n).

    ``Sampled`` where the servos tracked exactly these, and not straight lines between setpoints taken of them.
    """
    demands, t = recording.qref, recording.t - recording.t[0]
    assert demands is not None
    period = stated_period(arm)
    if (setpoints := setpoints_behind(demands, t, period)) is not None:
        knots = period * np.arange(len(setpoints))
        return lambda times: np.column_stack([np.interp(times, knots, column) for column in setpoints.T])
    samples = [(t[ok], column[ok]) for column in demands.T for ok in [np.isfinite(column)]]

    def demand(times: Array) -> Array:
        return np.column_stack([np.interp(times, stamps, column) for stamps, column in samples])

    return Sampled(demand) if tracked_as_recorded(recording, arm) else demand


def setpoints_behind(demands: Array, t: Array, period: float) -> Array | None:
    """(s, n): setpoints every ``period`` s from the first row on, between which demands (k, n) lie on straight lines.

    t (k,) s: of the rows, from 0. Of least squares, exact where they are such lines; None where they are not, or where
    the rows do not determine them.
    """
    if period <= 0.0 or len(t) * period <= t[-1] or not np.isfinite(demands).all():
        return None
    after, share = np.divmod(t / period + BENT, 1.0)
    after, share = after.astype(int), np.maximum(share - BENT, 0.0)
    count = int(after[-1]) + 1 + bool(share[-1] > 0.0)
    before, behind = np.minimum(after, count - 1), np.minimum(after + 1, count - 1)
    # normal equations: a row depends on the two setpoints about it
    bands = np.zeros((2, count))
    bands[1] = np.bincount(before, (1 - share) ** 2, count) + np.bincount(behind, share**2, count)
    bands[0] = np.bincount(behind, share * (1 - share), count)
    right = np.zeros((count, demands.shape[1]))
    np.add.at(right, before, (1 - share)[:, None] * demands)
    np.add.at(right, behind, share[:, None] * demands)
    try:
        setpoints: Array = solveh_banded(bands, right)
    except LinAlgError:
        return None
    lines = (1 - share)[:, None] * setpoints[before] + share[:, None] * setpoints[behind]
    return setpoints if np.abs(lines - demands).max() < BENT else None


def tracked_as_recorded(recording: Recording, arm: Arm) -> bool:
    """Whether the recorded demands are what the servos tracked, instead of the plan that a host sent setpoints of."""
    assert recording.qref is not None
    return stated_period(arm) < FEW * recording.dt or not _planned(recording.qref)


def _planned(demands: Array) -> bool:
    """Whether demands (n, J) bend at most rows in which they move."""
    first = np.diff(demands, axis=0)
    bend, moves = np.abs(np.diff(first, axis=0)), np.abs(first[1:]) > BENT
    return bool(moves.any()) and float(np.mean(bend[moves] > BENT)) > MOSTLY
