"""Temperatures of an arm's motors over the time of one recording or simulation: what its friction is evaluated at.

They are no property of the arm and stand in no model file. A recording's sensors are noisy, coarse and slow; the motor
is slower still. Its course is taken as straight lines between a few knots, by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array

BETWEEN = 10.0
"""s between two knots at least: motors warm up over minutes."""
MOST = 12
"""Knots at most."""
FEWEST = 2
"""Samples of a sensor from which its temperature is known."""


@dataclass(frozen=True)
class Temperatures:
    """time: K times, s from the start; degc: per joint K temperatures there, degC; () of a joint without a sensor.

    Straight lines between the times; constant before the first and after the last.
    """

    time: tuple[float, ...]
    degc: tuple[tuple[float, ...], ...]

    def at(self, joint: int, t: Array) -> Array | None:
        """(m,) degC of the motor of a joint (from 0) at times t (m,) s; None without a sensor."""
        values = self.degc[joint]
        return np.interp(t, self.time, values) if values else None


def constant_temperatures(degc: float, joints: int) -> Temperatures:
    """All motors of an arm at one temperature, degC."""
    return Temperatures((0.0,), ((degc,),) * joints)


def recorded_temperatures(t: Array, temperature: Array | None) -> Temperatures | None:
    """The course of temperatures (m, n) degC, NaN where missing, recorded at t (m,) s; None where nothing is."""
    if temperature is None or not np.isfinite(temperature).any():
        return None
    end = float(t[-1] - t[0])
    knots = t[0] + np.linspace(0.0, end, min(MOST, 1 + max(1, int(end / BETWEEN)))) if end > 0.0 else t[:1]
    return Temperatures(
        tuple(float(one) for one in knots), tuple(_course(t, values, knots) for values in temperature.T)
    )


def _course(t: Array, values: Array, knots: Array) -> tuple[float, ...]:
    seen = np.isfinite(values)
    if seen.sum() < FEWEST or len(knots) < 2:
        return (float(np.mean(values[seen])),) * len(knots) if seen.any() else ()
    hats = np.stack([np.interp(t[seen], knots, unit) for unit in np.eye(len(knots))], axis=1)
    # knots that no sample is near follow their neighbours
    bend = 1e-6 * np.sqrt(len(hats)) * np.diff(np.eye(len(knots)), axis=0)
    fitted = np.linalg.lstsq(np.concatenate([hats, bend]), np.append(values[seen], np.zeros(len(bend))), rcond=None)[0]
    return tuple(float(one) for one in fitted)
