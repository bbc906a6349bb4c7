"""Measured against simulated: the model's own closed loop on the demands of a recording.

Current and position errors of the simulation, per joint, as a user of the simulation sees them: no filter, the noise included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from arm_model.sensing import recorded
from arm_model.simulation import simulate
from daq.recording import Recording
from diagnosis.setup import loaded, setup_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Compared:
    """One recording beside its simulation: t (m,) s; measured and simulated current (m, n) A and angle (m, n) rad."""

    name: str
    t: Array
    current: Array
    simulated_current: Array
    angle: Array
    simulated_angle: Array

    def error_rms(self, signal: str) -> Array:
        """(n,) root mean square of measured less simulated ``current`` (A) or ``angle`` (rad)."""
        difference = getattr(self, signal) - getattr(self, f"simulated_{signal}")
        rms: Array = np.sqrt(np.nanmean(difference**2, axis=0))
        return rms


def compare(recording: Recording, arm: Arm) -> Compared | None:
    """The recording's demands run through the model's closed loop; None where there is no demand or no controller to run."""
    setup = setup_of(recording)
    if recording.qref is None or arm.controller is None or np.isnan(recording.qref).any() or setup.drives_off:
        return None
    arm = loaded(arm, setup.payload)
    knots, demanded = recording.t, recording.qref

    def demand(times: Array) -> Array:
        return np.column_stack([np.interp(times, knots, column) for column in demanded.T])

    duration = float(knots[-1])
    motion = simulate(arm, demand, duration=duration, rate=1.0 / recording.dt, times=knots - knots[0], sampled=True)
    shown = recorded(arm, motion)
    return Compared(recording.path.name, knots, recording.i, shown.current, recording.q, shown.q)
