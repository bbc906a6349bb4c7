"""Beats between the steps of an encoder and the rows of a recording, in the current that the motion predicts.

Quantisation is white noise while the steps pass at a rate that has nothing to do with that of the rows. Where a joint
passes nearly one step per row (or two, or three), the error repeats from row to row and drifts slowly: a tone in the
band of comparison, which two differentiations make several times as large as white noise of the same variance.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from arm_io.types import Array
from diagnosis.residual.noise.channels import angle_scatter, encoder_steps

HARMONICS = 6
"""Harmonics that are counted: the next has a fiftieth of the variance of the first."""
ROWS_TOGETHER = 15
"""Rows of a residual over which the variance is averaged: the memory of its filters."""
HIDDEN = 0.6
"""Scatter over the step above which no tone remains: that of the steps alone is below it (``channels.angle_noise``)."""


def steps_of(q: Array, steps: Array | None = None) -> Array:
    """(n,) rad: quantisation step of recorded angles (m, n); 0 for a joint without one, hidden by noise, or at rest.

    ``steps`` (n,) rad: those of the encoders, if the angles were interpolated.
    """
    steps = encoder_steps(q) if steps is None else steps
    return np.where(angle_scatter(q) > HIDDEN * steps, 0.0, steps)


def beat_variance(v: Array, steps: Array, rate: float, response: Callable[[Array], Array]) -> Array:
    """(m, n) variance that quantisation to ``steps`` (n,) rad leaves behind filters, at speeds v (m, n) rad/s.

    rate Hz: of the rows that were quantised; response: gain of the filters at frequencies in Hz.

    At constant speed the error is a sawtooth at f = |v| / step with harmonics of variance step^2 / (2 pi^2 k^2) at
    k f. In rows, each appears at its distance from the next multiple of their rate (Widrow & Kollar, Quantization
    Noise, Cambridge 2008).
    """
    passing = np.abs(v) / np.where(steps > 0.0, steps, np.inf)
    variance = np.zeros_like(v)
    for k in range(1, HARMONICS + 1):
        tone = np.abs(k * passing - np.round(k * passing / rate) * rate)
        variance += (steps * response(tone) / (np.pi * k)) ** 2 / 2
    averaged: Array = ndimage.uniform_filter1d(variance, ROWS_TOGETHER, axis=0, mode="nearest")
    return averaged
