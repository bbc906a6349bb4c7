"""The frequency of a residual that no variable predicts: what oscillates by itself has one, in every recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from arm_io.types import Array
from diagnosis.residual.filters import COMPARE_BAND, rate_of
from diagnosis.selection.design import Dataset

SLOWEST = 2.0
"""Hz: below it, a residual may follow the motion."""
WIDTH = 0.5
"""Hz on either side of a frequency that belong to it: an oscillation that friction stops and starts again is not
sharp."""
SHARE = 0.35
"""Of the power above SLOWEST that must lie there: of noise in the band of comparison, a twentieth does."""
PEAK = 2.0
"""Times the power of as wide a band below it: harmonics of a slow motion fall with the frequency."""
SECONDS = 4.0
"""Length of the segments of a spectrum, which resolves half of ``WIDTH``; and the shortest recording that has one."""


def wave_of(residual: Array, side: Dataset, joint: int) -> str | None:
    """``a wave of 5.0 Hz`` in the whitened residual (n * rows,) of a joint (from 1) of all recordings; else None."""
    power, frequency = np.zeros(0), np.arange(0.0, COMPARE_BAND + SLOWEST, 1.0 / SECONDS)
    for values, run in zip(side.by_recording(residual), side.runs, strict=True):
        rows = round(SECONDS * (rate := rate_of(run.t)))
        if len(values) >= rows:
            frequencies, density = signal.welch(values[:, joint - 1], rate, nperseg=rows)
            power = np.interp(frequency, frequencies, density) * len(values) + (power if len(power) else 0.0)
    if not len(power):
        return None
    band = (frequency >= SLOWEST) & (frequency <= COMPARE_BAND)
    line = peak(frequency, power, band)
    return None if line is None else f"a wave of {line[0]:.1f} Hz"


def peak(frequency: Array, power: Array, band: NDArray[np.bool_]) -> tuple[float, slice] | None:
    """Hz of a frequency that stands out of a spectrum in a band, and the places that belong to it; or None.

    frequency, power, band: (k,) Hz in steps of 1 / SECONDS, power, and where to search.
    """
    inside = np.where(band, power, 0.0)
    half = round(WIDTH * SECONDS)
    top = int(np.argmax(ndimage.uniform_filter1d(inside, 2 * half + 1, mode="constant")))
    peak_bins, bins_below = (
        slice(max(0, top - half), top + half + 1),
        slice(max(0, top - 3 * half - 1), max(0, top - half)),
    )
    if not inside.any() or inside[peak_bins].sum() < max(SHARE * inside.sum(), PEAK * power[bins_below].sum()):
        return None
    return float(np.average(frequency[peak_bins], weights=inside[peak_bins])), peak_bins
