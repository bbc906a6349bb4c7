"""Where the motion ends and the noise begins: cut-off frequencies read off the recording's own spectrum.

The spectrum of the acceleration, from positions differenced twice, falls where the motion of the arm ends and rises as
f^4 where encoder noise takes over. The cut-off for differentiation stands at twice the far side of the valley between
them, whatever the instrument. The second, parallel filter passes what the equations of motion speak about: twice the
band that holds 95 % of the power of the acceleration, and of the sign of the velocity, whose harmonics alone
distinguish Coulomb from viscous friction (Janot, Vandanjon, Gautier, IEEE T-CST 22 (2014) 132: at least twice the
bandwidth of the dynamics).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from arm_io.types import Array
from identification.preprocessing.filtering import butterworth, zero_phase

OCCUPIED = 0.95
"""Share of the acceleration's power that counts as the bandwidth of the dynamics."""
SPEEDY = 0.9
"""Share of the speed's power, without that of noise, that lies below the valley."""
STANDING = 0.02
"""Of a joint's peak speed: below it the sign of the velocity may be noise."""
SHAKEN = 0.01
"""Share of the largest travel, in units of the noise, from which a joint counts."""
SEGMENT = 8.0
"""s, length of Welch's segments: resolution 0.125 Hz."""


@dataclass(frozen=True)
class Band:
    """Cut-off frequencies (-6 dB, zero phase) common to all joints and both sides of the equations, Hz.

    ``motion`` for differentiating positions, ``parallel`` for the regression. ``frequency`` (f,) Hz and ``density`` (f,
    J), (rad/s2)^2/Hz, are the acceleration spectrum from which they were read, of the joints that count (``moving``
    (J,); None: none does); ``noise_rms`` (J,) rad is the white part of the position noise. turning: Hz below which the
    sign of the velocity has 95 % of its power.
    """

    motion: float
    parallel: float
    frequency: Array
    density: Array
    noise_rms: Array
    moving: NDArray[np.bool_] | None = None
    turning: float = 0.0

    def below(self, top: float) -> Band:
        """The band of a motion whose demands end at ``top`` Hz; what the arm does above them is no part of it.

        Half the rate of setpoints is such an end: a servo that interpolates between setpoints repeats the spectrum of
        their motion around every multiple of their rate. Soft gears and structure answer there, which equations of
        rigid links do not describe.
        """
        if self.moving is None or top >= self.parallel:
            return self
        inside = (self.frequency > 0) & (self.frequency <= top)
        dynamics = _occupied(self.frequency[inside], self.density[inside][:, self.moving])
        return replace(self, parallel=min(self.parallel, 2.0 * max(dynamics, self.turning), top))


def choose_band(q: Array, dt: float) -> Band:
    """The band of positions q (n, J) rad or m on a uniform grid of dt s. Joints that do not move do not count."""
    rate = 1.0 / dt
    segment = int(min(len(q) - 2, max(SEGMENT * rate, 16)))
    f, density = _spectra((np.diff(column, 2) / dt**2 for column in q.T), rate, segment)
    noise = _white_noise(f, density, dt)
    travel = np.ptp(q, axis=0) / np.maximum(noise, 1e-15)
    # Joints that are only shaken by a few counts are left out: their spectrum is that of quantisation.
    moving = travel > max(20.0, SHAKEN * travel.max())
    if not moving.any():
        return Band(rate / 4, rate / 8, f, density, noise)
    share = density[:, moving] / np.maximum(density[:, moving].max(axis=0), 1e-300)
    of_noise = 2 * dt * noise**2 * _second_difference(f, dt)[:, None]
    moved = (density - of_noise)[:, moving] / np.maximum(density[:, moving].max(axis=0), 1e-300)
    valley = _valley(f, share, _top_of_speed(f[1:], moved[1:]))
    # Twice: the noise let in by this is cut by the parallel filter, while a reversal, and with it friction, stays where
    # it was.
    motion = min(2.0 * valley, 0.25 / dt)
    inside = (f > 0) & (f <= valley)
    dynamics = _occupied(f[inside], share[inside])
    turns, sign_density = _spectra((_signs(column, dt, valley) for column in q.T[moving]), rate, segment)
    turning = _occupied(turns[1:], sign_density[1:])
    return Band(motion, min(valley, 2.0 * max(dynamics, turning)), f, density, noise, moving, turning)


def _spectra(signals: Iterable[Array], rate: float, segment: int) -> tuple[Array, Array]:
    """Frequencies (f,) Hz and power densities (f, k) of k signals (m,), one after the other (Welch)."""
    found = [signal.welch(each, rate, nperseg=segment) for each in signals]
    return found[0][0], np.stack([density for _, density in found], axis=1)


def _occupied(f: Array, density: Array) -> float:
    """Hz: frequency below which the share OCCUPIED of the mean power is, each column scaled to equal power."""
    power = np.cumsum(np.mean(density / np.maximum(density.sum(axis=0), 1e-300), axis=1))
    return float(f[np.searchsorted(power, OCCUPIED * power[-1])])


def _signs(q: Array, dt: float, cut: float) -> Array:
    """Direction of motion (n,) of a joint, 0 near standstill."""
    low_pass = butterworth(2, 2 * cut * dt)
    speed = np.gradient(zero_phase(low_pass, q), dt)
    return np.where(np.abs(speed) > STANDING * np.max(np.abs(speed)), np.sign(speed), 0.0)


def _white_noise(f: Array, density: Array, dt: float) -> Array:
    """(J,) rms of the white part of the position noise, from the upper spectrum of its second difference."""
    upper = (f > 0.3 / dt) & (f < 0.475 / dt)
    if not upper.any():
        return np.zeros(density.shape[1])
    gain = _second_difference(f[upper], dt)
    floor = np.median(density[upper] / gain[:, None], axis=0) / np.log(2)  # a periodogram's median is ln 2 of its mean
    return np.asarray(np.sqrt(floor / (2 * dt)))


def _second_difference(f: Array, dt: float) -> Array:
    """(f,) 1/s4: what the second difference of positions makes of the power of white noise."""
    return np.asarray((2 * np.sin(np.pi * f * dt) / dt) ** 4)


def _top_of_speed(f: Array, moved: Array) -> float:
    """Hz below which SPEEDY of the speed's power is, of acceleration densities (f, J) of the motion alone.

    A motion of a few sine waves has valleys between them that are deeper than the one before the noise.
    """
    power = np.cumsum(np.mean(moved, axis=1) / f**2)
    return float(f[int(np.argmax(power >= SPEEDY * power[-1]))])


def _valley(f: Array, share: Array, above: float) -> float:
    """The frequency of least power ``above`` Hz, beyond that of the motion itself.

    It is the minimum of the joints' mean log spectrum, smoothed over a third of an octave.
    """
    level = np.mean(np.log(np.maximum(share[1:], 1e-300)), axis=1)
    octave = np.log2(f[1:])
    grid = np.arange(octave[0], octave[-1], 1 / 24)
    total = np.concatenate([[0.0], np.cumsum(level)])
    first = np.searchsorted(octave, grid - 1 / 6, side="left")
    last = np.maximum(np.searchsorted(octave, grid + 1 / 6, side="right"), first + 1)
    last = np.minimum(last, len(level))
    first = np.minimum(first, last - 1)
    smooth = (total[last] - total[first]) / (last - first)
    # Above half the Nyquist frequency anti-aliasing filters cause valleys too, and filters ring for long.
    frequency = 2.0**grid
    below = frequency <= 0.5 * f[-1]
    usable = below & (frequency >= min(above, _foot(frequency[below], smooth[below]), 0.25 * f[-1]))
    floor, frequency = smooth[usable], frequency[usable]
    lowest = int(np.argmin(floor))
    # the upper end of the valley, where the power has doubled again
    risen = np.flatnonzero(floor[lowest:] > floor[lowest] + np.log(2.0))
    return float(frequency[lowest + (risen[0] if len(risen) else 0)])


def _foot(frequency: Array, level: Array) -> float:
    """Hz: where the power (its logarithm ``level``) that falls from the highest frequency downwards ends to fall.

    The slope of the noise leads there, also where steps of a coarse encoder have more speed than the motion.
    """
    lowest = np.minimum.accumulate(level[::-1])
    risen = np.flatnonzero(level[::-1] > lowest + np.log(2.0))
    return float(frequency[::-1][np.argmin(level[::-1][: risen[0] if len(risen) else None])])
