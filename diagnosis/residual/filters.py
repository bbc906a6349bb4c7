"""Zero-phase filters by which measured and predicted signals are smoothed alike, and the rows that are kept of them."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from identification.preprocessing import butterworth, zero_phase

MOTION_BAND = 60.0
"""Hz: pass-band of the motion from which the model's currents are computed."""
COLUMN_BAND = 10.0
"""Hz: pass-band of the motion from which the columns of effects are computed."""
COMPARE_BAND = 20.0
"""Hz: pass-band in which measured and expected currents are compared."""
ORDER = 4
"""Of the low-pass filter."""
ROWS_PER_SECOND = 100
"""Of a residual, about: the filters leave no more."""
TRANSIENT = 0.2
"""s that are left out at both ends of a recording: transients of the filters."""

Samples = tuple[Array, Array, Array]
"""Times t (m,) s, angles q (m, n) rad and currents i (m, n) A of a recording."""
Motion = tuple[Array, Array, Array]
"""Angle, speed and acceleration (m, n)."""


def low_pass(values: Array, band: float, rate: float) -> Array:
    """(m, ...) zero-phase fourth-order Butterworth along the first axis; ``band`` and ``rate`` of the rows: Hz."""
    return zero_phase(butterworth(ORDER, band / (rate / 2)), values, pad=min(len(values) - 1, int(3 * rate / band)))


def low_pass_gain(frequency: Array, band: float) -> Array:
    """(m,) amplitude that ``low_pass`` leaves of 1 at frequencies (m,) Hz: a Butterworth filter, both ways."""
    return np.asarray(1.0 / (1.0 + (frequency / band) ** (2 * ORDER)))


def rate_of(t: Array) -> float:
    """Hz: rows per second of uniform times t (m,) s."""
    return 1.0 / float(np.median(np.diff(t)))


def rate_along(values: Array, step: float) -> Array:
    """Derivative of values (m, ...) along their rows, ``step`` s apart: that of their cubic spline.

    At a fifth of the rate of the rows, differences of the rows on both sides are a quarter too small, a spline 1 %.
    """
    t = step * np.arange(len(values))
    spline = CubicSpline(t, values)
    # the derivative at the first row of each piece is the coefficient of its linear term
    return np.concatenate([spline.c[2], spline(t[-1:], 1)])


def motion_of(q: Array, band: float, rate: float) -> Motion:
    """Angle, speed and acceleration (m, n) of recorded angles q (m, n), as far as they lie in the band."""
    angle = low_pass(q, band, rate)
    speed = np.gradient(angle, 1.0 / rate, axis=0)
    return angle, speed, np.gradient(speed, 1.0 / rate, axis=0)


def kept_rows(rate: float) -> slice:
    """Rows of a recording at ``rate`` Hz that are kept: about ROWS_PER_SECOND of them, without filter transients."""
    return slice(int(TRANSIENT * rate), -int(TRANSIENT * rate), max(1, round(rate / ROWS_PER_SECOND)))


def rate_kept(rate: float) -> float:
    """Rows per second of those that are ``kept_rows`` of a recording at ``rate`` Hz: 125 of 250, 111 of 333."""
    return rate / (kept_rows(rate).step or 1)
