"""Segments -> demanded joint positions over time.

The demand is a continuous function of time, evaluated on whole arrays. Nothing is expanded: what is repeated a million
times takes no more memory than what is repeated twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from experiment.bounds import FELT, Bounds, joined, resting
from experiment.pieces import Piece, Polyline, Series, Standing, Sweep, Trapezoid
from experiment.segments import Chirp, Drive, Fourier, Hold, Move, Repeat, Segment, Setpoints

if TYPE_CHECKING:
    from experiment.file import Experiment

NOTHING = 1e-12
"""rad (m): a distance that no encoder shows, and whose reciprocal is still a number."""
LONGEST = 31 * 86400.0
"""s: a month. Whoever writes more has mistyped a number."""
SHOWN = 3
"""Of passes that repeat one another: how many show all there is to see, together with the last."""


@dataclass(frozen=True)
class Demand:
    """Demanded joint positions of one experiment: ``demand(t)`` for t (n,) s gives (n, joints) rad or m.

    Before 0 it stands at the start, after ``duration`` at ``end`` (joints,). It is a ``Piece`` of pieces that follow
    one another, from ``starts`` (pieces,) s on.
    """

    duration: float
    starts: Array
    pieces: tuple[Piece, ...]
    end: Array

    def __call__(self, times: Array) -> Array:
        times = np.atleast_1d(np.asarray(times, float))
        q = np.empty((len(times), len(self.end)))
        which = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.pieces) - 1)
        for piece in np.unique(which):
            rows = which == piece
            q[rows] = self.pieces[piece](np.maximum(times[rows] - self.starts[piece], 0.0))
        q[times >= self.duration] = self.end
        return q

    def bounds(self, start: float, stop: float) -> Bounds:
        """What it asks for between two times at most; beyond its ends it rests."""
        first = max(int(np.searchsorted(self.starts, start, side="left")) - 1, 0)
        last = max(int(np.searchsorted(self.starts, stop, side="right")) - 1, first)
        ends = [self.pieces[k].bounds(start - self.starts[k], stop - self.starts[k]) for k in {first, last}]
        return joined([*ends, *self._whole[first + 1 : last]], self._shortest)

    def spans(self) -> list[tuple[float, float]]:
        """Stretches of time that show all there is to see, s; what is left out repeats them."""
        found: list[tuple[float, float]] = []
        for start, piece in zip(self.starts.tolist(), self.pieces):
            inner = piece.spans() if isinstance(piece, Demand | Repeated | Series) else [(0.0, piece.duration)]
            for begin, end in ((start + begin, start + end) for begin, end in inner):
                if found and begin <= found[-1][1] + FELT:
                    found[-1] = (min(begin, found[-1][0]), max(end, found[-1][1]))
                else:
                    found.append((begin, end))
        return found

    @cached_property
    def _whole(self) -> list[Bounds]:
        return [piece.bounds(-FELT, piece.duration + FELT) for piece in self.pieces]

    @cached_property
    def _shortest(self) -> float:
        return min(piece.duration for piece in self.pieces)


@dataclass(frozen=True)
class Repeated:
    """A motion repeated ``times`` times: the ``first`` pass, then ``steady`` ones, each from the end of the one before.

    A joint that some segment sends to a position is there again after every pass; one that is only driven by distances
    goes on by the same way each time.
    """

    first: Demand
    steady: Demand
    times: int

    @property
    def duration(self) -> float:
        return self.first.duration + (self.times - 1) * self.steady.duration

    @property
    def way(self) -> Array:
        """(n,) rad or m of one steady pass."""
        return self.steady.end - self.first.end

    @property
    def end(self) -> Array:
        return self.first.end + (self.times - 1) * self.way

    def __call__(self, t: Array) -> Array:
        later = np.maximum(t - self.first.duration, 0.0)
        passes = np.clip(np.floor(later / self.steady.duration), 0, max(self.times - 2, 0))
        q = self.steady(later - passes * self.steady.duration) + np.outer(passes, self.way)
        beginning = t < self.first.duration
        q[beginning] = self.first(t[beginning])
        return q

    def bounds(self, start: float, stop: float) -> Bounds:
        parts = [self.first.bounds(start, stop)] if start <= self.first.duration else []
        begin, end = start - self.first.duration, stop - self.first.duration
        period, last = self.steady.duration, self.times - 2
        if end >= 0.0 and last >= 0:
            low, high = (int(np.clip(time // period, 0, last)) for time in (begin, end))
            if low == high:
                parts.append(self.steady.bounds(begin - low * period, end - low * period).shifted(low * self.way))
            else:
                whole = self.steady.bounds(-FELT, period + FELT)
                parts += [whole.shifted(low * self.way), whole.shifted(high * self.way)]
        return joined(parts or [resting(self.end)], min(self.first.duration, period))

    def spans(self) -> list[tuple[float, float]]:
        inner, period = self.steady.spans(), self.steady.duration
        found = self.first.spans()
        for number in sorted({*range(min(SHOWN, self.times - 1)), self.times - 2} - {-1}):
            begin = self.first.duration + number * period
            found += [(begin + start - 2 * FELT, begin + end) for start, end in inner]
        return found


def demand_of(experiment: Experiment) -> Demand:
    """The demand of an experiment. InputError where it lasts longer than ``LONGEST``."""
    demand = _sequence(experiment.segment, np.array(experiment.start, float), experiment)
    if not demand.duration <= LONGEST:
        days = demand.duration / 86400
        raise InputError(
            f"experiment {experiment.name!r}", f"lasts {days:.4g} days; at most {LONGEST / 86400:g} can be run"
        )
    return demand


def _sequence(segments: Sequence[Segment], at: Array, experiment: Experiment) -> Demand:
    """The demand of segments that begin at (n,) rad or m."""
    starts, pieces, clock = [], [], 0.0
    for segment in segments:
        piece = _piece(segment, at, experiment)
        at = piece.end
        if piece.duration <= 0.0:
            continue
        starts.append(clock)
        pieces.append(piece)
        clock += piece.duration
    if not pieces:
        starts, pieces = [0.0], [Standing(0.0, at)]
    return Demand(clock, np.array(starts), tuple(pieces), at)


def _piece(segment: Segment, at: Array, experiment: Experiment) -> Piece:
    """What a segment asks of an arm that stands at (n,)."""
    match segment:
        case Hold():
            return Standing(segment.duration, at)
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
            return Series(segment, at)
        case Chirp():
            return Sweep(segment, at)
        case Setpoints():
            return Polyline.of(segment, at)
        case Repeat():
            return _repeated(segment, at, experiment)
    raise TypeError(f"no reference for a segment of type {segment.type!r}")


def _trapezoid(at: Array, target: Array, fraction: float, experiment: Experiment) -> Piece:
    """All joints keep the slowest joint's profile."""
    distance = np.abs(target - at)
    moving = distance > NOTHING
    if not moving.any():
        return Standing(0.0, target)
    # In units of the path parameter s: the tightest joint's speed and acceleration.
    speed = float(np.min(fraction * np.array(experiment.full_speed)[moving] / distance[moving]))
    acceleration = float(np.min(np.array(experiment.full_acceleration)[moving] / distance[moving]))
    return Trapezoid(at, target, min(speed, float(np.sqrt(acceleration))), acceleration)


def _repeated(segment: Repeat, at: Array, experiment: Experiment) -> Piece:
    first = _sequence(segment.segment, at, experiment)
    if segment.times == 1:
        return first
    steady = first if np.array_equal(first.end, at) else _sequence(segment.segment, first.end, experiment)
    if steady.duration <= 0.0:
        return first
    return Repeated(first, steady, segment.times)
