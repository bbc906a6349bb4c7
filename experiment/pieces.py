"""The pieces of a demand: what each kind of segment asks for, as a function of the time within it, with its bounds.

Trapezoidal moves: with distance D, speed v and acceleration a, ramps of v / a each where D >= v^2 / a, else a triangle
of peak speed sqrt(a D).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from arm_io.types import Array
from experiment.bounds import FELT, STEP, Bounds, resting
from experiment.segments import Chirp, Fourier, Setpoints

SAMPLES = 512
"""Of the fastest harmonic: between two the series leaves its samples by 2e-5 of its amplitude at most."""


class Piece(Protocol):
    """A motion of n joints that lasts ``duration`` s and leads to ``end`` (n,) rad or m.

    Called with times (k,) s from 0 to ``duration`` it gives (k, n) positions. ``bounds`` holds from start to stop, s,
    which may reach beyond both ends, where the piece rests.
    """

    @property
    def duration(self) -> float: ...
    @property
    def end(self) -> Array: ...
    def __call__(self, t: Array, /) -> Array: ...
    def bounds(self, start: float, stop: float) -> Bounds: ...


@dataclass(frozen=True)
class Standing:
    """At one place."""

    duration: float
    end: Array

    def __call__(self, t: Array) -> Array:
        return np.broadcast_to(self.end, (len(t), len(self.end)))

    def bounds(self, start: float, stop: float) -> Bounds:
        return resting(self.end)


@dataclass(frozen=True)
class Trapezoid:
    """From ``begin`` to ``end``; all joints share one profile s(t) from 0 to 1: q = begin + (end - begin) s.

    ``speed`` 1/s and ``acceleration`` 1/s2 are those of s.
    """

    begin: Array
    end: Array
    speed: float
    acceleration: float

    @property
    def duration(self) -> float:
        return 1.0 / self.speed + self.speed / self.acceleration

    def __call__(self, t: Array) -> Array:
        return self.begin + np.outer(self._share(t), self.end - self.begin)

    def _share(self, t: Array) -> Array:
        ramp, duration = self.speed / self.acceleration, self.duration
        t = np.clip(t, 0.0, duration)
        up = np.minimum(t, ramp)
        flat = np.clip(t - ramp, 0.0, duration - 2 * ramp)
        down = np.clip(t - (duration - ramp), 0.0, ramp)
        return self.acceleration * (up**2 - down**2) / 2 + self.speed * (flat + down)

    def bounds(self, start: float, stop: float) -> Bounds:
        ends = self(np.array([start, stop]))
        distance, still = np.abs(self.end - self.begin), np.zeros_like(self.end)
        return Bounds(ends.min(axis=0), ends.max(axis=0), distance * self.speed, distance * self.acceleration, still)


def _fade(t: Array, duration: float, fade: float) -> Array:
    """Quintic step up over the first and down over the last ``fade`` seconds."""
    x = np.clip(np.minimum(t, duration - t) / fade, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def _fading(start: float, stop: float, duration: float, fade: float) -> tuple[float, float, float]:
    """Largest value, rate and curvature of the fade between two times."""
    nearest = np.array([np.clip(duration / 2, start, stop)])
    if start >= fade and stop <= duration - fade:
        return 1.0, 0.0, 0.0
    return float(_fade(nearest, duration, fade)[0]), 15 / 8 / fade, 10 / np.sqrt(3) / fade**2


@dataclass(frozen=True)
class Series:
    """A finite Fourier series about ``end``, faded in and out."""

    segment: Fourier
    end: Array

    @property
    def duration(self) -> float:
        return self.segment.duration

    def __call__(self, t: Array) -> Array:
        fade = _fade(t, self.segment.duration, self.segment.fade)
        return self.end + fade[:, None] * self._series(t, 0)

    def _series(self, t: Array, derivative: int) -> Array:
        """(k, n) the series or a derivative of it."""
        sine, cosine = np.array(self.segment.sine, float), np.array(self.segment.cosine, float)
        pulsations = 2 * np.pi * self.segment.fundamental * np.arange(1, sine.shape[1] + 1)
        phase = np.outer(t, pulsations) + derivative * np.pi / 2
        level = 1.0 if derivative == 0 else 0.0
        return (
            np.sin(phase) @ (sine * pulsations**derivative).T
            + (np.cos(phase) - level) @ (cosine * pulsations**derivative).T
        )

    @cached_property
    def _period(self) -> list[tuple[Array, Array]]:
        """Bounds of the series, its rate and its curvature: extremes of samples over one period, and between them."""
        amplitudes = np.abs(np.array(self.segment.sine, float)) + np.abs(np.array(self.segment.cosine, float))
        harmonics = np.arange(1, amplitudes.shape[1] + 1)
        period, pulsation = 1 / self.segment.fundamental, 2 * np.pi * self.segment.fundamental
        step = period / (SAMPLES * max(len(harmonics), 1))
        t = np.arange(0.0, period, step)
        extremes = []
        for derivative in range(3):
            values = self._series(t, derivative)
            between = amplitudes @ (harmonics * pulsation) ** (derivative + 2) * step**2 / 8
            extremes.append((values.min(axis=0) - between, values.max(axis=0) + between))
        return extremes

    def spans(self) -> list[tuple[float, float]]:
        """Stretches that show all there is to see: both fades, and a period between them."""
        segment, period = self.segment, 1.0 / self.segment.fundamental
        last = segment.duration - segment.fade - 2 * FELT
        if segment.fade + period >= last:
            return [(0.0, segment.duration)]
        return [(0.0, segment.fade + period), (last, segment.duration)]

    def bounds(self, start: float, stop: float) -> Bounds:
        value, rate, curvature = _fading(start, stop, self.segment.duration, self.segment.fade)
        (low, high), speeds, accelerations = self._period
        reach, speed, acceleration = (
            np.maximum(-lowest, highest) for lowest, highest in ((low, high), speeds, accelerations)
        )
        return Bounds(
            self.end + value * np.minimum(low, 0.0),
            self.end + value * np.maximum(high, 0.0),
            rate * reach + value * speed,
            curvature * reach + 2 * rate * speed + value * acceleration,
            np.zeros_like(reach),
        )


@dataclass(frozen=True)
class Sweep:
    """One joint on a sine of rising or falling frequency about ``end``, faded in and out."""

    segment: Chirp
    end: Array

    @property
    def duration(self) -> float:
        return self.segment.duration

    @property
    def _rise(self) -> float:
        """Hz/s."""
        return (self.segment.to_frequency - self.segment.frequency) / self.segment.duration

    def __call__(self, t: Array) -> Array:
        segment = self.segment
        q = np.tile(self.end, (len(t), 1))
        phase = 2 * np.pi * (segment.frequency * t + self._rise * t**2 / 2)
        q[:, segment.joint - 1] += segment.amplitude * _fade(t, segment.duration, segment.fade) * np.sin(phase)
        return q

    def bounds(self, start: float, stop: float) -> Bounds:
        segment = self.segment
        value, rate, curvature = _fading(start, stop, segment.duration, segment.fade)
        ends = np.clip([start, stop], 0.0, segment.duration)
        pulsation = 2 * np.pi * float(np.max(segment.frequency + self._rise * ends))
        turn = value * (pulsation**2 + 2 * np.pi * abs(self._rise))
        joint = np.arange(len(self.end)) == segment.joint - 1
        reach = np.where(joint, abs(segment.amplitude), 0.0)
        return Bounds(
            self.end - value * reach,
            self.end + value * reach,
            reach * (rate + value * pulsation),
            reach * (curvature + 2 * rate * pulsation + turn),
            np.zeros_like(reach),
        )


@dataclass(frozen=True)
class Polyline:
    """A table of positions, linear in between. ``jump`` (n,): from where the arm stands to the first position."""

    times: Array
    positions: Array
    jump: Array

    @staticmethod
    def of(segment: Setpoints, at: Array) -> Polyline:
        """The table of a segment, for an arm that stands at (n,)."""
        positions = np.array(segment.positions, float)
        return Polyline(np.array(segment.times, float), positions, np.abs(positions[0] - at))

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    @property
    def end(self) -> Array:
        return self.positions[-1]

    def __call__(self, t: Array) -> Array:
        return np.column_stack([np.interp(t, self.times, column) for column in self.positions.T])

    @cached_property
    def _speeds(self) -> Array:
        """(rows - 1, n) between the rows."""
        return np.abs(np.diff(self.positions, axis=0)) / np.diff(self.times)[:, None]

    @cached_property
    def _corners(self) -> Array:
        """(rows + 1, n) sum of the jumps of speed before each row.

        The motion is at rest before the first row and after the last.
        """
        slopes = np.diff(self.positions, axis=0) / np.diff(self.times)[:, None]
        still = np.zeros((1, self.positions.shape[1]))
        jumps = np.abs(np.diff(np.concatenate([still, slopes, still]), axis=0))
        return np.concatenate([still, np.cumsum(jumps, axis=0)])

    def bounds(self, start: float, stop: float) -> Bounds:
        first = max(int(np.searchsorted(self.times, start, side="right")) - 1, 0)
        last = min(int(np.searchsorted(self.times, stop, side="left")), len(self.times) - 1)
        ends = self(np.clip([start, stop], 0.0, self.duration))
        inside = np.concatenate([ends, self.positions[first + 1 : last]])
        speed = self._speeds[first : max(last, first + 1)].max(axis=0, initial=0.0)
        window_end = np.searchsorted(self.times, self.times[first : last + 1] + 2 * FELT, side="right")
        sums = self._corners[window_end] - self._corners[first : last + 1]
        corner = sums.max(axis=0) / FELT
        if start <= 0.0:
            speed, corner = speed + self.jump / STEP, corner + self.jump / FELT**2
        return Bounds(inside.min(axis=0), inside.max(axis=0), speed, np.zeros_like(speed), corner)
