"""Hall-effect current transducer (RS 257-436 in the thesis): motor current -> turns through the core -> volts.

    V = offset + (1 + gain_error) rated_voltage / rated_current (N I) + noise,  through a first-order lag of its
        bandwidth

The thesis's I = (20 V - C_off) / N is this read backwards, for 200 A -> 10 V. What the turns are for: one step of a
12-bit converter over +-10 V is 4.88 mV, and 4.88 mV is 98 mA through the core, 9.8 mA in a motor lead wound ten times
through it, 4.9 mA at twenty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array


@dataclass(frozen=True)
class HallTransducer:
    """n transducers; arrays (n,), but for the ratings.

    turns          of the motor lead through the core
    offset         V at no current
    gain_error     relative
    noise          V, standard deviation
    bandwidth      Hz, -3 dB
    rated_current  A through the core, at which it gives ``rated_voltage`` V; it saturates 5 % above
    """

    turns: Array
    offset: Array
    gain_error: Array
    noise: Array
    bandwidth: float
    rated_current: float
    rated_voltage: float


def lagged(transducer: HallTransducer, current: Array, step: float, before: Array) -> Array:
    """Current as the core sees it: the lag's exact response to a current that is linear between rows ``step`` s apart.

    current (m + 1, n) A from the row before on, before (n,) A the lag's output there; returns (m, n), its output at
    rows 1 ... m.
    """
    tau = 1.0 / (2.0 * np.pi * transducer.bandwidth)
    decay = math.exp(-step / tau)
    ramp = tau / step * (1.0 - decay)
    # y1 = decay y0 + (1 - decay) u0 + (1 - ramp) (u1 - u0): first-order hold.
    drive = (1.0 - ramp) * current[1:] + (ramp - decay) * current[:-1]
    drive[0] += decay * before
    age = 1  # y[i] = decay y[i - 1] + x[i], the sum over ever longer pasts: twice as long in each round
    while age < len(drive) and decay**age > 1e-18:
        drive[age:] += decay**age * drive[:-age]
        age *= 2
    return drive


def volts(transducer: HallTransducer, current: Array, noise: Array) -> Array:
    """Output (..., n) V for the (lagged) current (..., n) A; noise in standard deviations."""
    scale = transducer.rated_voltage / transducer.rated_current * transducer.turns * (1.0 + transducer.gain_error)
    ceiling = 1.05 * transducer.rated_voltage
    return np.clip(scale * current, -ceiling, ceiling) + transducer.offset + transducer.noise * noise
