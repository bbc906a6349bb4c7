"""What the instruments leave in a residual current, in the band of comparison: transducers, and steps of encoders."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from diagnosis.residual.filters import COMPARE_BAND, MOTION_BAND
from diagnosis.residual.noise.beats import beat_variance, steps_of
from diagnosis.residual.noise.channels import KnownNoise, angle_noise, current_noise

RESOLVED = 3e-4
"""Share of the rms current that sampled rows resolve, however small the noise of the instruments is.

Between two rows a current acts as its servo holds it, and a motion is what its samples and their filters leave of it. A
simulated recording without noise shows these errors of inverse dynamics.
"""


def residual_gain(frequency: Array) -> Array:
    """(m,) amplitude that the filters of motion and of comparison leave of 1 at frequencies (m,) Hz."""
    # the eighth power by squaring: numpy's takes ten times as long
    compare, motion = (np.square(np.square(np.square(frequency / band))) for band in (COMPARE_BAND, MOTION_BAND))
    share: Array = 1.0 / (1.0 + compare) / (1.0 + motion)
    return share


def channel_noise(q: Array, i: Array, inertia: Array, rate: float, known: KnownNoise, period: float) -> Array:
    """(n,) A: ``instrument_noise``, but no less than sampled rows resolve."""
    return np.maximum(instrument_noise(q, i, inertia, rate, known, period), resolved(i)) + 1e-9


def without_noise(q: Array, i: Array, inertia: Array, rate: float, known: KnownNoise) -> bool:
    """Whether the instruments of a recording leave less at any joint than sampled rows resolve.

    Arguments as of ``instrument_noise``; what servos do at setpoints of any period is no noise of theirs.
    """
    return bool(np.any(instrument_noise(q, i, inertia, rate, known, period=1.0) < resolved(i)))


def resolved(i: Array) -> Array:
    """(n,) A: what sampled rows resolve of currents i (k, n)."""
    return np.asarray(RESOLVED * np.sqrt(np.mean(i**2, axis=0)))


def instrument_noise(q: Array, i: Array, inertia: Array, rate: float, known: KnownNoise, period: float) -> Array:
    """(n,) A: standard deviation of the residual from the instruments alone, in the band of comparison.

    inertia (k, n, n) A s2/rad: currents per acceleration, at some rows; period s: of the servos' setpoints, 0: unknown.
    Current: its scatter or steps, taken for white, or its std at standstill, if that is known and larger. What servos
    do at setpoints of a known period is no noise (``setpoint_ripple``).
    Angle: its step or scatter, through two differentiations and the joint's own inertia. See ``channels``.
    What a simulated loop does as well is noise of neither.
    """
    loop = known.loop
    white = current_noise(i, between_lines=period > 0.0, beside=None if loop is None else loop.current)
    q = q if loop is None else q - loop.angle
    frequency = np.linspace(0.0, rate / 2, 2000)
    through = residual_gain(frequency)
    share = np.trapezoid(1.0 / (1.0 + (frequency / COMPARE_BAND) ** 8) ** 2, frequency) / (rate / 2)
    wobble = np.trapezoid(((2 * np.pi * frequency) ** 2 * through) ** 2, frequency) / (rate / 2)
    mean_inertia = inertia.diagonal(axis1=1, axis2=2).mean(axis=0)
    from_angle = mean_inertia * angle_noise(q, known.steps) * np.sqrt(wobble)
    from_current = np.maximum(white * np.sqrt(share), known.still)
    return np.asarray(np.hypot(from_current, from_angle))


def row_by_row(noise: Array, q: Array, v: Array, inertia: Array, rate: float, known: KnownNoise) -> Array:
    """(m, n) A: ``noise`` (n,) or, at speeds v (m, n) at which encoder steps beat with the rows, what the beats leave.

    inertia: as of ``channel_noise``.
    An acceleration that is wrong at one joint is wrong in the currents of all that its inertia couples.
    """
    beats = beat_variance(v, steps_of(q, known.steps), rate, lambda f: (2 * np.pi * f) ** 2 * residual_gain(f))
    return np.sqrt(np.maximum(noise**2, beats @ np.mean(inertia**2, axis=0).T))
