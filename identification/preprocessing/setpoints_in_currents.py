"""Whether recorded currents show that rows come at a multiple of the rate of setpoints, where these are not stated.

A model from a URDF file says nothing of its controller. But transients at setpoints are lines of the current at whole
multiples of the setpoints' rate, and follow the acceleration (``setpoint_ripple``): with n rows per setpoint the
product of current and acceleration has a line at 1/n of the sampling rate, and beside it none. It is compared with
the product some Hz beside it. Nothing nearby may be larger: setpoints of another rate have their line there.
"""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.fft import next_fast_len

from arm_io.types import Array

MOST = 10
"""Rows per setpoint; of more, the line that folds is far below those that are seen."""
SECONDS = 5.0
"""s of a stretch, over which the clocks of rows and setpoints stay in phase."""
NEIGHBOURHOOD = (4.0, 14.0)
"""Hz from a line: where the product has no line of the setpoints; the modulation by the acceleration is narrower."""
PEAK = 1.0
"""Distance from a line, over the resolution 1/``SECONDS`` Hz, up to which a frequency counts as the line itself."""
CHANCE = 1e-8
"""Probability, per joint and number of rows, that noise has such a line."""


def rows_between_setpoints(ripple: Array, acceleration: Array, rate: float) -> int:
    """Rows per setpoint, at ``rate`` rows per second; 0 where no joint shows any.

    ripple (m, J): currents or torques without what a low-pass leaves of them; acceleration (m, J): below that low-pass;
    NaN where a row is missing. Of several numbers the largest, because every n rows show the lines of a part of n.
    """
    parts = np.array_split(np.arange(len(ripple)), max(1, int(len(ripple) / rate / SECONDS)))
    stretches = [np.nan_to_num(ripple[part] * _changing(acceleration[part])) for part in parts]
    length = next_fast_len(max(map(len, stretches)), real=True)
    power = np.sum([np.abs(np.fft.rfft(stretch, length, axis=0)) ** 2 for stretch in stretches], axis=0)
    hertz = np.arange(len(power)) * rate / length
    for rows in range(MOST, 1, -1):
        line = np.sum([_at_line(stretch, rows) for stretch in stretches], axis=0)
        away = np.abs(hertz - rate / rows)
        beside = power[(away > NEIGHBOURHOOD[0]) & (away < NEIGHBOURHOOD[1]) & (hertz > 0.0)]
        if not len(beside):
            continue
        skirts = power[(away > PEAK / SECONDS) & (away <= NEIGHBOURHOOD[0])].max(axis=0, initial=0.0)
        level, there = beside.mean(axis=0), np.any(beside > 0.0, axis=0) & (line > skirts)
        # bins closer than a stretch is long repeat one another
        freedom_beside = 2 * len(stretches) * max(1, int(len(beside) * rate / length * SECONDS))
        # at the Nyquist frequency the transform is real: one degree of freedom in place of two
        freedom = (1 if rows == 2 else 2) * len(stretches)
        if np.any(stats.f.sf(line[there] / level[there], freedom, freedom_beside) < CHANCE):
            return rows
    return 0


def _at_line(stretch: Array, rows: int) -> Array:
    """(J,) power of a stretch (m, J) at 1/``rows`` of the sampling rate exactly."""
    wave = np.exp(-2j * np.pi * np.arange(len(stretch)) / rows)
    return np.asarray(np.abs(wave @ stretch) ** 2)


def _changing(acceleration: Array) -> Array:
    """(m, J) without its mean, slope and curvature: a steady line, as of the mains, is none of its product."""
    trends = np.vander(np.linspace(-1.0, 1.0, len(acceleration)), 3)
    return np.asarray(acceleration - trends @ np.linalg.lstsq(trends, acceleration, rcond=None)[0])
