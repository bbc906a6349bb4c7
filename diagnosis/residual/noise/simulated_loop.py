"""What a residual shows of its own method: the residual of a simulation, under the model that was simulated.

Servos act at setpoints, rows show their currents at instants, and filters pass a motion on to inverse dynamics without
what happens between rows. Where no noise is larger, a residual is that: at few rows per setpoint, several thousandths
of the current. A closed loop on the same demands has it, too, as far as its model is that of the recording, so that it
can be subtracted (deferred correction: Stetter, Numerische Mathematik 29, 1978).
"""

from __future__ import annotations

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.sensing import recorded
from arm_model.simulation import simulate_at
from daq.recording import Recording
from diagnosis.residual.expected_current import predicted_current
from diagnosis.residual.filters import COMPARE_BAND, Samples, kept_rows, low_pass, rate_of
from diagnosis.residual.noise.channels import SimulatedLoop
from diagnosis.residual.run_setup import has_demand, set_up
from identification.preprocessing import demand_of_run

UNLIKE = 0.5
"""Share of a current's power above the band of comparison that a loop may leave.

There are the transients of setpoints that sampling puts into the band, and little of an error of the model.
"""


def simulated_loop(arm: Arm, recording: Recording, samples: Samples) -> SimulatedLoop | None:
    """The closed loop of a model on the demands of a recording; None without demand, controller or stable loop.

    samples: t (k,) s, q (k, n) rad, i (k, n) A of its rows.
    """
    if arm.controller is None or not has_demand(recording):
        return None
    (t, _, i), arm = samples, set_up(arm, recording)
    rate = rate_of(t)
    try:
        motion = simulate_at(arm, demand_of_run(recording, arm), t - t[0])
        shown = recorded(arm, motion)
        expected = predicted_current(arm, t, shown.q)
    except InputError:  # the loop is unstable
        return None
    like = _power_above(i - shown.current, rate) < UNLIKE * _power_above(i, rate)
    residual = low_pass(shown.current - expected, COMPARE_BAND, rate)[kept_rows(rate)]
    return SimulatedLoop(shown.q * like, shown.current * like, residual * like)


def _power_above(current: Array, rate: float) -> Array:
    """(n,) A2: of currents (k, n), above the band of comparison."""
    return np.asarray(np.mean((current - low_pass(current, COMPARE_BAND, rate)) ** 2, axis=0))
