"""A current that oscillates while the arm stands: a servo that hunts about rest, which no effect of the catalogue is.

It is no noise of the instrument either. Noise, white or correlated, follows no wave for long, and none of the same
frequency in every recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from daq.recording import Recording
from diagnosis.cause import Signal, Structure
from diagnosis.residual.filters import COMPARE_BAND, low_pass
from diagnosis.residual.noise.channels import floor, standstill

SHARE = 0.75
"""Of the variance of a standing current that a wave must predict; of noise it is 0.2 to 0.7 over half a second."""
PERIODS = 2.5
"""That must fit into the standstill: slower waves are drifts."""
SAME = 1.0
"""Hz by which the frequencies of recordings may differ."""
LASTS = 0.5
"""Amplitude in the second half over that in the first: a servo that settles is no oscillation."""
STEP = 0.1
"""Hz between frequencies that are tried."""


@dataclass(frozen=True)
class Oscillation:
    """Of the current of a joint (from 1): Hz, A, and its share of the variance, the least of all recordings."""

    joint: int
    frequency: float
    amplitude: float
    share: float

    def structure(self, unit: str) -> Structure:
        """As what no effect explains."""
        size = f"{self.amplitude:.2g} {unit} while the arm stands"
        return Structure(Signal.CURRENT, self.joint, f"a wave of {self.frequency:.1f} Hz", self.share, size)


def oscillations(recordings: Sequence[Recording]) -> list[Oscillation]:
    """Currents that oscillate in the standstill of every recording that has one; recordings with drives on."""
    still = [(recording, rows) for recording in recordings if (rows := standstill(recording)) is not None]
    if not still:
        return []
    of_each = [_waves(recording, rows) for recording, rows in still]
    oscillating = []
    for joint, waves in enumerate(zip(*of_each), 1):
        frequency, amplitude, share = np.array(waves).T
        if share.min() > SHARE and np.ptp(frequency) <= SAME:
            sizes = np.median(frequency), np.mean(amplitude), share.min()
            oscillating.append(Oscillation(joint, *map(float, sizes)))
    return oscillating


def _waves(recording: Recording, rows: slice) -> list[tuple[float, float, float]]:
    """Hz, A and share of the wave that predicts most, by joint.

    A share of 0 where it does not last, or is no larger than the scatter from row to row.
    """
    t, white = recording.t[rows] - recording.t[rows][0], floor(recording.i)
    values = low_pass(recording.i, COMPARE_BAND, 1.0 / recording.dt)[rows]
    straight = np.column_stack([np.ones_like(t), t])
    values = values - straight @ np.linalg.lstsq(straight, values, rcond=None)[0]
    power = np.maximum(np.sum(values**2, axis=0), 1e-300)
    frequencies = np.arange(PERIODS / t[-1], COMPARE_BAND, STEP)
    residual = np.array([np.sum((values - _fitted(f, t, values)) ** 2, axis=0) for f in frequencies])
    best, half = np.argmin(residual, axis=0), len(t) // 2
    waves = []
    for j, k in enumerate(best):
        parts = [values[rows_of, j] for rows_of in (slice(None), slice(None, half), slice(half, None))]
        amplitude, early, late = (float(np.sqrt(2.0) * np.std(part)) for part in parts)
        lasts = late > LASTS * early and amplitude > white[j]
        waves.append((float(frequencies[k]), amplitude, float(1.0 - residual[k, j] / power[j]) if lasts else 0.0))
    return waves


def _fitted(frequency: float, t: Array, values: Array) -> Array:
    """(m, n) the wave of a frequency, Hz, with a straight line, that is nearest to values (m, n) at t (m,) s."""
    turn = 2 * np.pi * frequency * t
    columns = np.column_stack([np.sin(turn), np.cos(turn), np.ones_like(t), t])
    return np.asarray(columns @ np.linalg.lstsq(columns, values, rcond=None)[0], float)
