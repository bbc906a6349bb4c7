"""Motions whose joints each follow a finite Fourier series, as experiments and as rows.

Swevers et al., Optimal robot excitation and identification, IEEE T-RA 13(5), 1997.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from experiment import Experiment, demand_of
from experiment.segments import Fourier, Hold
from identification.experiment_design.limits import Limits


@dataclass(frozen=True)
class Series:
    """The finite Fourier series of every joint: duration s, fundamental Hz, number of harmonics.

    The duration is preferably a whole number of periods of the fundamental.
    """

    duration: float = 20.0
    fundamental: float = 0.1
    harmonics: int = 5


@dataclass(frozen=True)
class Shapes:
    """The motion per unit of each coefficient of a series, at given instants: a motion is linear in its coefficients.

    t (k,) s; position, speed and acceleration (k, 2 harmonics): of the sines, then of the cosines, faded.
    """

    t: Array
    position: Array
    speed: Array
    acceleration: Array

    @staticmethod
    def of(series: Series, rows: int) -> Shapes:
        """At ``rows`` instants from begin to end."""
        unit = np.eye(2 * series.harmonics)
        free = Limits(np.zeros((len(unit), 2)), *np.ones((3, len(unit))))
        return Shapes(*sampled(fourier_motion(unit, np.zeros(len(unit)), free, series), rows))

    def motions(self, start: Array, weights: Array) -> tuple[Array, Array, Array]:
        """q, q', q'' (m, k, n) of m motions about ``start`` (m, n) with coefficients (m, n, 2 harmonics)."""
        turned = np.swapaxes(weights, 1, 2)
        return start[:, None, :] + self.position @ turned, self.speed @ turned, self.acceleration @ turned


def fourier_motion(weights: Array, start: Array, limits: Limits, series: Series) -> Experiment:
    """weights (n, 2 harmonics) rad: sines, then cosines, about ``start`` (n,) rad."""
    moving = Fourier(
        type="fourier",
        duration=series.duration,
        fundamental=series.fundamental,
        sine=weights[:, : series.harmonics].tolist(),
        cosine=weights[:, series.harmonics :].tolist(),
        fade=min(1.0, series.duration / 4),
    )
    return Experiment(
        name="excitation",
        description="Finite Fourier series, optimised to show the base parameters",
        start=start.tolist(),
        full_speed=limits.speed.tolist(),
        full_acceleration=limits.acceleration.tolist(),
        segment=[Hold(type="hold", duration=0.5), moving, Hold(type="hold", duration=0.5)],
    )


def sampled(experiment: Experiment, rows: int) -> tuple[Array, Array, Array, Array]:
    """t, q, q', q'' of an experiment's demand at ``rows`` instants, derivatives by central differences."""
    demand = demand_of(experiment)
    t = np.linspace(0.0, demand.duration, rows)
    h = 1e-3
    before, here, after = demand(t - h), demand(t), demand(t + h)
    return t, here, (after - before) / (2 * h), (after - 2 * here + before) / h**2
