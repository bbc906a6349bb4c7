"""Where a motion comes nearest to what it must keep clear of, without looking at every instant of it.

Branch and bound: no point of a link moves faster than its distance from the axes times the speeds of the joints
(``Chain.reach``), so that a distance at one instant bounds it around that instant. A stretch whose bound is above the
least distance found so far is not looked at; what repeats itself is looked at once (``Demand.spans``).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import count

import numpy as np

from arm_clearance.pairs import Pairs
from arm_io.types import Array
from experiment import STEP, Demand

LONG = 30.0
"""s of a stretch that is looked at in steps; a longer one is halved first."""
STEPS = (64, 8, 1)
"""Instants of ``STEP`` s between two looks, from the first look at a stretch to the last."""
EXACT = 5e-4
"""m by which the least distance may be less than what is found."""


@dataclass(frozen=True, kw_only=True)
class Nearest:
    """The least distance of a motion, compared with what must be kept.

    room       m: distance less what must be kept of it; negative where it is not kept
    clearance  m between the surfaces of ``one`` and ``other``, at ``time`` s
    """

    room: float
    clearance: float
    time: float
    one: str
    other: str


def nearest(demand: Demand, pairs: Pairs) -> Nearest | None:
    """The distance of which least is left, to ``EXACT`` m; None where there is nothing to keep clear of."""
    if not len(pairs):
        return None
    search = _Search(demand, pairs)
    number = count()
    waiting: list[tuple[float, int, float, float]] = []

    def enter(start: float, stop: float) -> None:
        heapq.heappush(waiting, (search.bound(start, stop), next(number), start, stop))

    for start, stop in demand.spans():
        enter(max(start, 0.0), min(stop, demand.duration))
    while waiting:
        bound, _, start, stop = heapq.heappop(waiting)
        if bound >= search.least - EXACT:
            break
        if stop - start > LONG:
            middle = (start + stop) / 2
            enter(start, middle)
            enter(middle, stop)
        else:
            search.walk(start, stop)
    one, other = pairs.names()[search.pair]
    required = float(pairs.required()[search.pair])
    return Nearest(room=search.least, clearance=search.least + required, time=search.time, one=one, other=other)


class _Search:
    """The least room found so far, of which pair (from 0), and when."""

    def __init__(self, demand: Demand, pairs: Pairs) -> None:
        self._demand, self._pairs, self._required = demand, pairs, pairs.required()
        whole = demand.bounds(0.0, demand.duration)
        self._rates = pairs.rates(np.maximum(np.abs(whole.low), np.abs(whole.high)))
        self.least, self.pair, self.time = np.inf, 0, 0.0

    def bound(self, start: float, stop: float) -> float:
        """M that are left at least between two times, s."""
        middle, half = np.array([(start + stop) / 2]), (stop - start) / 2
        return float(self._look(middle, half, self._demand.bounds(start, stop).speed, (start, stop))[0])

    def walk(self, start: float, stop: float) -> None:
        """Looks at a stretch as closely as it may hold what is nearer than all so far."""
        speed = self._demand.bounds(start, stop).speed
        times = np.arange(start, stop, STEPS[0] * STEP) + STEPS[0] * STEP / 2
        for step, finer in zip(STEPS, (*STEPS[1:], None)):
            half = step * STEP / 2
            left = self._look(np.minimum(times, stop), half, speed, None)
            times = times[left < self.least - EXACT]
            if finer is None or not len(times):
                return
            inside = (np.arange(step // finer) + 0.5) * finer * STEP - half
            times = (times[:, None] + inside).ravel()
            times = times[times <= stop + finer * STEP]

    def _look(self, times: Array, half: float, speed: Array, span: tuple[float, float] | None) -> Array:
        """(k,) m that are left at least within ``half`` s of the times (k,)."""
        q = self._demand(times)
        room = self._pairs.clearance(q) - self._required
        place = int(np.argmin(room))
        row, pair = divmod(place, room.shape[1])
        if room[row, pair] < self.least:
            self.least, self.pair, self.time = float(room[row, pair]), pair, float(times[row])
        way = np.broadcast_to(speed * (half + STEP), q.shape)
        if span is not None:
            bounds = self._demand.bounds(*span)
            way = np.minimum(way, np.maximum(bounds.high - q, q - bounds.low))
        return np.asarray((room - way @ self._rates.T).min(axis=1))
