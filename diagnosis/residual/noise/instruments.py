"""What the instruments leave in a residual current, in the band of comparison: transducers, and steps of encoders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from diagnosis.residual.filters import COMPARE_BAND, MOTION_BAND, low_pass
from diagnosis.residual.noise.beats import beat_variance, steps_of
from diagnosis.residual.noise.channels import KnownNoise, angle_noise, current_noise
from identification.preprocessing import choose_band

RESOLVED = 3e-4
"""Share of the rms current that sampled rows resolve, however small the noise of the instruments is.

Between two rows a current acts as its servo holds it, and a motion is what its samples and their filters leave of it. A
simulated recording without noise shows these errors of inverse dynamics.
"""
SMOOTH_BAND = 12.0
"""Hz to which angles of coarse steps are smoothed.

Below, reversals of friction are smeared: a delay of 19 ms is estimated as 14.
"""
MOTION_ENDS = 30.0
"""Hz: cut-off for the differentiation of angles below which the motion is smooth enough for that."""
MOVES = 2.0
"""Std of angles from ``SMOOTH_BAND`` to ``COMPARE_BAND``, over that of their steps, above which they move there; in a
fifth of all seconds: a slow joint turns its steps into a wave. Healthy arms have 1.5 at most, ripples of 14 Hz 2.3."""
OFTEN = 0.8
"""Share of the seconds that may have less."""
COARSE = 4.0
"""Noise of the residual by encoders over that by transducers, median of the joints, from which on steps are coarse."""


def residual_gain(frequency: Array, of_angles: float = np.inf) -> Array:
    """(m,) amplitude that the filters of motion and of comparison leave of 1 at frequencies (m,) Hz.

    of_angles: Hz to which the angles were smoothed before; inf: they were not.
    """
    # the eighth power by squaring: numpy's takes ten times as long
    bands = COMPARE_BAND, MOTION_BAND, of_angles
    compare, motion, smooth = (np.square(np.square(np.square(frequency / band))) for band in bands)
    share: Array = 1.0 / (1.0 + compare) / (1.0 + motion) / (1.0 + smooth)
    return share


@dataclass(frozen=True)
class Channels:
    """Angles and currents of all joints as they were recorded.

    q, i     (k, n) rad (m) and A, ``rate`` rows/s
    inertia  (k, n, n) A s2/rad: currents per acceleration, at some rows
    known    what is known of their noise
    """

    q: Array
    i: Array
    inertia: Array
    rate: float
    known: KnownNoise


def channel_noise(channels: Channels, period: float) -> Array:
    """(n,) A: ``instrument_noise``, but no less than sampled rows resolve."""
    return np.maximum(instrument_noise(channels, period), resolved(channels.i)) + 1e-9


def without_noise(channels: Channels) -> bool:
    """Whether the instruments of a recording leave less at any joint than sampled rows resolve.

    What servos do at setpoints of any period is no noise of theirs.
    """
    return bool(np.any(instrument_noise(channels, period=1.0) < resolved(channels.i)))


def resolved(i: Array) -> Array:
    """(n,) A: what sampled rows resolve of currents i (k, n)."""
    return np.asarray(RESOLVED * np.sqrt(np.mean(i**2, axis=0)))


def instrument_noise(channels: Channels, period: float) -> Array:
    """(n,) A: standard deviation of the residual from the instruments alone, in the band of comparison.

    period s: of the servos' setpoints, 0: unknown.
    Current: its scatter or steps, taken for white, or its std at standstill, if that is known and larger. What servos
    do at setpoints of a known period is no noise (``setpoint_ripple``).
    Angle: its step or scatter, through two differentiations and the joint's own inertia. See ``channels``.
    What a simulated loop does as well is noise of neither.
    """
    return np.hypot(_of_currents(channels, period), _of_angles(channels))


def _of_currents(channels: Channels, period: float) -> Array:
    """(n,) A: noise of recorded currents below the comparison band."""
    i, rate, known = channels.i, channels.rate, channels.known
    white = current_noise(i, between_lines=period > 0.0, beside=None if known.loop is None else known.loop.current)
    frequency = np.linspace(0.0, rate / 2, 2000)
    share = np.trapezoid(1.0 / (1.0 + (frequency / COMPARE_BAND) ** 8) ** 2, frequency) / (rate / 2)
    return np.maximum(white * np.sqrt(share), known.still)


def _of_angles(channels: Channels) -> Array:
    """(n,) A: noise of recorded angles, differentiated twice, times the mean inertia of each joint."""
    rate, known = channels.rate, channels.known
    q = channels.q if known.loop is None else channels.q - known.loop.angle
    frequency = np.linspace(0.0, rate / 2, 2000)
    through = residual_gain(frequency, known.band)
    square = np.trapezoid(((2 * np.pi * frequency) ** 2 * through) ** 2, frequency) / (rate / 2)
    mean_inertia = channels.inertia.diagonal(axis1=1, axis2=2).mean(axis=0)
    return np.asarray(mean_inertia * angle_noise(q, known.steps) * np.sqrt(square))


def band_of_angles(channels: Channels) -> float:
    """Hz to which the angles of encoders with coarse steps are smoothed; inf where none are.

    Differentiated twice, steps of a milliradian are more than the acceleration of the arm below 20 Hz. Smoothed further
    than the currents they leave a fourth of it: what the motion has above is less than their noise (``choose_band``).
    They are not where a ripple moves a joint in between (``_moves_between``): its torque would be one without a motion.
    """
    q, rate, known = channels.q, channels.rate, channels.known
    if known.steps is None or known.loop is not None or known.residual is not None:
        return np.inf
    of_currents = _of_currents(replace(channels, known=replace(known, still=0.0)), 0.0)
    ratio = (_of_angles(channels) / np.maximum(of_currents, 1e-300))[known.steps > 0.0]
    coarse = len(ratio) > 0 and float(np.median(ratio)) > COARSE  # all joints are smoothed alike
    if not coarse or _moves_between(q, rate, known.steps) or choose_band(q, 1.0 / rate).motion >= MOTION_ENDS:
        return np.inf
    return SMOOTH_BAND


def _moves_between(q: Array, rate: float, steps: Array) -> bool:
    """Whether any joint moves from ``SMOOTH_BAND`` to ``COMPARE_BAND`` by more than its ``steps`` (n,) rad leave."""
    moved = low_pass(q, COMPARE_BAND, rate) - low_pass(q, SMOOTH_BAND, rate)
    rows = max(1, round(rate))
    seconds = moved[: len(moved) // rows * rows].reshape(-1, rows, q.shape[1])
    if not len(seconds):
        return False
    usual = np.quantile(np.sqrt(np.mean(seconds**2, axis=1)), OFTEN, axis=0)
    of_steps = steps * np.sqrt((COMPARE_BAND - SMOOTH_BAND) / (rate / 2.0) / 12.0)
    return bool(np.any((usual > MOVES * of_steps)[steps > 0.0]))


def smoothed(q: Array, rate: float, band: float) -> Array:
    """Angles q (n, J) rad of ``rate`` rows/s below ``band`` Hz; as they are where that is inf, or no band of theirs."""
    return low_pass(q, band, rate) if band < 0.45 * rate else q


def row_by_row(noise: Array, v: Array, channels: Channels) -> Array:
    """(m, n) A: ``noise`` (n,) or, at speeds v (m, n) at which encoder steps beat with the rows, what the beats leave.

    An acceleration that is wrong at one joint is wrong in the currents of all that its inertia couples.
    """
    steps, band = steps_of(channels.q, channels.known.steps), channels.known.band
    beats = beat_variance(v, steps, channels.rate, lambda f: (2 * np.pi * f) ** 2 * residual_gain(f, band))
    return np.sqrt(np.maximum(noise**2, beats @ np.mean(channels.inertia**2, axis=0).T))
