"""Whether recorded currents show that rows come at a multiple of the rate of setpoints.

A model from a URDF file says nothing of its controller, and another may state a controller that the arm does not have.
But transients at setpoints are lines of the current at whole
multiples of the setpoints' rate, and follow the acceleration (``setpoint_ripple``): with n rows per setpoint the
product of current and acceleration has a line at 1/n of the sampling rate, and beside it none. It is compared with
the product some Hz beside it. Nothing nearby may be larger: setpoints of another rate have their line there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
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
STATED = np.array([1, 2, 3])
"""Lines of stated setpoints, the strongest of them: where one is seen, the setpoints come as stated."""
SAME = 1e-3
"""Difference of a ratio of periods from a whole number, up to which the lines of one are among those of the other."""


def seen_at(lines: NDArray[np.int_], period: float, rate: float) -> Array:
    """Hz at which rows at ``rate`` Hz show lines of setpoints every ``period`` s."""
    frequency = lines / period
    return np.asarray(np.abs(frequency - np.round(frequency / rate) * rate))


class _Product(NamedTuple):
    """Of ripple and acceleration: stretches (m, J), and the sum of their power (f, J) at hertz (f,)."""

    stretches: list[Array]
    power: Array
    hertz: Array
    length: int
    rate: float


def rows_between_setpoints(ripple: Array, acceleration: Array, rate: float) -> int:
    """Rows per setpoint, at ``rate`` rows per second; 0 where no joint shows any.

    ripple (m, J): currents or torques without what a low-pass leaves of them; acceleration (m, J): below that low-pass;
    NaN where a row is missing. Of several numbers the largest, because every n rows show the lines of a part of n.
    """
    return _rows_shown(_product(ripple, acceleration, rate))


def rows_against(period: float, ripple: Array, acceleration: Array, rate: float) -> int:
    """Rows per setpoint where the currents refute a stated ``period`` (s) of setpoints; else 0.

    Other arguments as of ``rows_between_setpoints``. They refute it by lines that are none of its own, while none of
    its own is there.
    """
    product = _product(ripple, acceleration, rate)
    rows = _rows_shown(product)
    if not rows:
        return 0
    ratio = max(period * rate / rows, rows / (period * rate))
    if abs(ratio - round(ratio)) < SAME:
        return 0
    return 0 if any(_shows(product, float(hz)) for hz in seen_at(STATED, period, rate)) else rows


def _rows_shown(product: _Product) -> int:
    return next((rows for rows in range(MOST, 1, -1) if _shows(product, product.rate / rows)), 0)


def _product(ripple: Array, acceleration: Array, rate: float) -> _Product:
    parts = np.array_split(np.arange(len(ripple)), max(1, int(len(ripple) / rate / SECONDS)))
    stretches = [np.nan_to_num(ripple[part] * _changing(acceleration[part])) for part in parts]
    length = next_fast_len(max(map(len, stretches)), real=True)
    power = np.sum([np.abs(np.fft.rfft(stretch, length, axis=0)) ** 2 for stretch in stretches], axis=0)
    return _Product(stretches, power, np.arange(len(power)) * rate / length, length, rate)


def _shows(product: _Product, hz: float) -> bool:
    """Whether the product of any joint has a line at ``hz``, up to the Nyquist frequency, that noise has not."""
    stretches, power, hertz, length, rate = product
    line = np.sum([_at_line(stretch, hz / rate) for stretch in stretches], axis=0)
    away = np.abs(hertz - hz)
    beside = power[(away > NEIGHBOURHOOD[0]) & (away < NEIGHBOURHOOD[1]) & (hertz > 0.0)]
    if not len(beside):
        return False
    skirts = power[(away > PEAK / SECONDS) & (away <= NEIGHBOURHOOD[0])].max(axis=0, initial=0.0)
    level = beside.mean(axis=0)
    there: NDArray[np.bool_] = np.any(beside > 0.0, axis=0) & (line > skirts)
    # bins closer than a stretch is long repeat one another
    freedom_beside = 2 * len(stretches) * max(1, int(len(beside) * rate / length * SECONDS))
    # at the Nyquist frequency the transform is real: one degree of freedom in place of two
    freedom = (1 if hz == rate / 2 else 2) * len(stretches)
    return bool(np.any(stats.f.sf(line[there] / level[there], freedom, freedom_beside) < CHANCE))


def _at_line(stretch: Array, share: float) -> Array:
    """(J,) power of a stretch (m, J) at ``share`` of the sampling rate exactly."""
    wave = np.exp(-2j * np.pi * share * np.arange(len(stretch)))
    return np.asarray(np.abs(wave @ stretch) ** 2)


def _changing(acceleration: Array) -> Array:
    """(m, J) without its mean, slope and curvature: a steady line, as of the mains, is none of its product."""
    trends = np.vander(np.linspace(-1.0, 1.0, len(acceleration)), 3)
    return np.asarray(acceleration - trends @ np.linalg.lstsq(trends, acceleration, rcond=None)[0])
