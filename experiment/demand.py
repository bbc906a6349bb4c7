"""Segments -> demanded joint positions over time.

The demand is a continuous function of time, evaluated on whole arrays. Trapezoidal moves: with distance D, speed v and
acceleration a, ramps of v / a each where D >= v^2 / a, else a triangle of peak speed sqrt(a D).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from experiment.file import Experiment
from experiment.segments import Chirp, Drive, Fourier, Hold, Move, Repeat, Segment, Setpoints

Piece = Callable[[Array], Array]
NOTHING = 1e-12  # rad (m): a distance that no encoder shows, and whose reciprocal is still a number


@dataclass(frozen=True)
class Demand:
    """Demanded joint positions of one experiment: ``demand(t)`` for t (n,) s gives (n, joints) rad or m.

    Before 0 it stands at the start, after ``duration`` at the end.
    """

    duration: float
    starts: Array  # (pieces,) s
    pieces: tuple[Piece, ...]
    end: Array  # (joints,)

    def __call__(self, times: Array) -> Array:
        times = np.atleast_1d(np.asarray(times, float))
        q = np.empty((len(times), len(self.end)))
        which = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.pieces) - 1)
        for piece in np.unique(which):
            rows = which == piece
            q[rows] = self.pieces[piece](np.maximum(times[rows] - self.starts[piece], 0.0))
        q[times >= self.duration] = self.end
        return q


def demand_of(experiment: Experiment) -> Demand:
    """The demand of an experiment."""
    at = np.array(experiment.start, float)
    starts, pieces, clock = [], [], 0.0
    for segment in _flat(experiment.segment):
        duration, piece, end = _piece(segment, at, experiment)
        at = end
        if duration <= 0.0:
            continue
        starts.append(clock)
        pieces.append(piece)
        clock += duration
    if not pieces:
        starts, pieces = [0.0], [_standing(at)]
    return Demand(clock, np.array(starts), tuple(pieces), at)


def _flat(segments: list[Segment]) -> Iterator[Segment]:
    for segment in segments:
        if isinstance(segment, Repeat):
            for _ in range(segment.times):
                yield from _flat(segment.segment)
        else:
            yield segment


def _piece(segment: Segment, at: Array, experiment: Experiment) -> tuple[float, Piece, Array]:
    """Duration, position at a time within the segment, and end position."""
    match segment:
        case Hold():
            return segment.duration, _standing(at), at
        case Drive():
            target = at.copy()
            if segment.to is not None:
                target[segment.joint - 1] = segment.to
            elif segment.by is not None:
                target[segment.joint - 1] += segment.by
            return _trapezoid(at, target, segment.speed, experiment)
        case Move():
            return _trapezoid(at, np.array(segment.to, float), segment.speed, experiment)
        case Fourier():
            return segment.duration, _fourier(segment, at), at
        case Chirp():
            return segment.duration, _chirp(segment, at), at
        case Setpoints():
            return _table(segment)
    raise TypeError(f"no demand for a segment of type {segment.type!r}")


def _standing(at: Array) -> Piece:
    return lambda t: np.broadcast_to(at, (len(t), len(at)))


def _trapezoid(at: Array, target: Array, fraction: float, experiment: Experiment) -> tuple[float, Piece, Array]:
    """All joints share the slowest joint's profile s(t) from 0 to 1: q = at + (target - at) s."""
    distance = np.abs(target - at)
    moving = distance > NOTHING
    if not moving.any():
        return 0.0, _standing(target), target
    # In units of the path parameter s: the tightest joint's speed and acceleration.
    speed = float(np.min(fraction * np.array(experiment.full_speed)[moving] / distance[moving]))
    acceleration = float(np.min(np.array(experiment.full_acceleration)[moving] / distance[moving]))
    speed = min(speed, np.sqrt(acceleration))
    ramp = speed / acceleration
    duration = 1.0 / speed + ramp

    def position(t: Array) -> Array:
        t = np.clip(t, 0.0, duration)
        up = np.minimum(t, ramp)
        flat = np.clip(t - ramp, 0.0, duration - 2 * ramp)
        down = np.clip(t - (duration - ramp), 0.0, ramp)
        s = acceleration * up**2 / 2 + speed * flat + speed * down - acceleration * down**2 / 2
        return at + np.outer(s, target - at)

    return duration, position, target


def _fade(t: Array, duration: float, fade: float) -> Array:
    """Quintic step up over the first and down over the last ``fade`` seconds."""
    x = np.clip(np.minimum(t, duration - t) / fade, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def _fourier(segment: Fourier, at: Array) -> Piece:
    sine, cosine = np.array(segment.sine, float), np.array(segment.cosine, float)
    pulsations = 2 * np.pi * segment.fundamental * np.arange(1, sine.shape[1] + 1)

    def position(t: Array) -> Array:
        phase = np.outer(t, pulsations)
        series = np.sin(phase) @ sine.T + (np.cos(phase) - 1.0) @ cosine.T
        return at + _fade(t, segment.duration, segment.fade)[:, None] * series

    return position


def _chirp(segment: Chirp, at: Array) -> Piece:
    sweep = (segment.to_frequency - segment.frequency) / segment.duration

    def position(t: Array) -> Array:
        q = np.tile(at, (len(t), 1))
        phase = 2 * np.pi * (segment.frequency * t + sweep * t**2 / 2)
        q[:, segment.joint - 1] += segment.amplitude * _fade(t, segment.duration, segment.fade) * np.sin(phase)
        return q

    return position


def _table(segment: Setpoints) -> tuple[float, Piece, Array]:
    times, positions = np.array(segment.times), np.array(segment.positions, float)

    def position(t: Array) -> Array:
        return np.column_stack([np.interp(t, times, column) for column in positions.T])

    return float(times[-1]), position, positions[-1]
