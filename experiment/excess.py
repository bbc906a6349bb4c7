"""Where a demand asks for more than some limits allow, found without looking at every instant of it.

Branch and bound: a stretch whose bounds keep all limits is not looked at; one that may break them is halved, and looked
at instant by instant once it is short. What is found is what a look at every instant finds, at the cost of those few
that matter: a day's motion takes milliseconds, and as much memory as half a minute's.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from arm_io.types import Array
from experiment.bounds import FELT, STEP
from experiment.demand import Demand

BLOCK = 1 << 15
"""Instants that are looked at together."""
LOOKS = 64
"""Blocks that are looked at for the furthest value of limits that are known to be broken."""
WINDOW = round(FELT / STEP)


class Kind(StrEnum):
    """What a limit is of."""

    LOW = "low"
    HIGH = "high"
    SPEED = "speed"
    ACCELERATION = "acceleration"


@dataclass(frozen=True)
class Excess:
    """A limit of a joint (from 1) that a demand does not keep; ``value``: the furthest that it goes, in rad (m), s."""

    kind: Kind
    joint: int
    value: float


def excesses(
    demand: Demand,
    *,
    low: Array | None = None,
    high: Array | None = None,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> list[Excess]:
    """What a demand asks for beyond limits (n,) each, in the order of ``Kind`` within a joint; None: any is allowed.

    Positions, speeds and accelerations as ``experiment.bounds`` looks at them. A position that is not finite is beyond
    every limit.
    """
    n = len(demand.end)
    free = np.full(n, np.finfo(float).max)
    limits = np.stack(
        [free if some is None else some for some in (None if low is None else -low, high, speed, acceleration)]
    )
    found = _beyond(demand, limits)
    return [
        Excess(kind, joint + 1, float(-found[k, joint] if kind is Kind.LOW else found[k, joint]))
        for joint in range(n)
        for k, kind in enumerate(Kind)
        if not found[k, joint] <= limits[k, joint]
    ]


def _beyond(demand: Demand, limits: Array) -> Array:
    """(4, n) the largest -position, position, speed and acceleration beyond ``limits`` (4, n).

    Where they are not beyond them, some value within. The stretches whose bounds go furthest come first: what they
    reach excludes most others. Where it does not, ``LOOKS`` blocks are enough for the value of a limit that is known to
    be broken; every instant is checked.
    """
    most = limits.copy()
    waiting: list[tuple[float, int, int, Array]] = []

    def enter(first: int, last: int) -> None:
        reach = demand.bounds(first * STEP, (last + 2 * WINDOW) * STEP).reach
        if not (reach <= most).all():
            beyond = np.nan_to_num(reach - limits, nan=np.inf).max()
            heapq.heappush(waiting, (-float(beyond), first, last, reach))

    for first, last in _stretches(demand):
        enter(first, last)
    looks = 0
    while waiting:
        _, first, last, reach = heapq.heappop(waiting)
        enough = (most > limits) & (looks >= LOOKS)
        if ((reach <= most) | enough).all():
            continue
        if last - first <= BLOCK:
            most = np.maximum(most, _looked_at(demand, first, last))
            looks += 1
        else:
            middle = (first + last) // 2
            enter(first, middle)
            enter(middle, last)
    return most


def _stretches(demand: Demand) -> Iterator[tuple[int, int]]:
    """Numbers of the instants to look at, from first to last, exclusive."""
    end = 0
    for start, stop in demand.spans():
        first, last = max(int(start / STEP), end), min(int(np.ceil(stop / STEP)) + 1, instants_of(demand))
        if last > first:
            yield first, last
            end = last


def instants_of(demand: Demand) -> int:
    """How many instants a look at every one of them would take: 0, STEP ... until the motion has ended."""
    return int(np.ceil((demand.duration + STEP) / STEP))


def _looked_at(demand: Demand, first: int, last: int) -> Array:
    """(4, n) largest -position, position, speed and acceleration at instants first ... last - 1.

    Each instant includes the motion up to the next one.
    """
    q = demand(np.arange(first, min(last + 2 * WINDOW, instants_of(demand)), dtype=float) * STEP)
    rows = last - first
    bend = q[2 * WINDOW :] - 2 * q[WINDOW:-WINDOW] + q[: -2 * WINDOW]
    seen = np.stack(
        [
            -q[:rows].min(axis=0),
            q[:rows].max(axis=0),
            np.abs(np.diff(q[: rows + 1], axis=0)).max(axis=0, initial=0.0) / STEP,
            np.abs(bend).max(axis=0, initial=0.0) / FELT**2,
        ]
    )
    return np.where(np.isfinite(seen), seen, np.inf)
