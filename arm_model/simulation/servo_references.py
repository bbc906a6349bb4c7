"""Demands of the host as references of the servos, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm

Demand = Callable[[Array], Array]
"""t (k,) s -> demanded positions (k, n) rad (m); motor currents for an arm without controller.

Behind them, where the base floats and they are given: (k, thrusters) N, added to what the base's controller asks for.
"""


def servo_period(arm: Arm) -> float:
    """s between two ticks of the servos; of the current table for an arm without controller."""
    return arm.servo_period


@dataclass(frozen=True)
class Sampled:
    """A demand recorded at the servo's ticks: taken as it is, without interpolation between the setpoints of a host."""

    demand: Demand

    def __call__(self, t: Array) -> Array:
        """t (k,) s -> demanded positions (k, n) rad (m)."""
        return self.demand(t)


def references(arm: Arm, demand: Demand, first: int, count: int) -> Array:
    """(count, n) references of the servos at ticks first, first + 1, ...

    The host sends demand(k setpoint_period); the servos interpolate linearly in between. A ``Sampled`` demand is taken
    at the ticks themselves.
    """
    times: Array = np.arange(first, first + count, dtype=np.float64) * servo_period(arm)
    if arm.controller is None or isinstance(demand, Sampled):
        return np.asarray(demand(times), dtype=np.float64)
    period = arm.controller.setpoint_period
    start, end = math.floor(times[0] / period + 1e-9), math.ceil(times[-1] / period + 1e-9) + 1
    knots = np.arange(start, end + 1) * period
    setpoints = np.asarray(demand(knots), dtype=np.float64)
    return np.column_stack([np.interp(times, knots, setpoints[:, j]) for j in range(setpoints.shape[1])])


def row_times(duration: float, rate: float) -> Array:
    """(R,) s: rows at ``rate`` per second from 0 to ``duration``, both ends included."""
    return np.asarray(np.arange(int(np.floor(duration * rate + 1e-9)) + 1) / rate)
