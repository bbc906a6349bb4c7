"""The trigger line: its edges, and what a device with a fault on its input sees of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend.rig.faults import ExtraEdge, Fault, LostEdge, LostRow

Times = NDArray[np.int64]


@dataclass(frozen=True)
class TriggerLine:
    """Low-to-high edges at first_ns + k period_ns, k = 0, 1 ..., in ns of the host's clock.

    edges  limit of k; None: without end
    """

    first_ns: int
    period_ns: float
    edges: int | None = None

    def times(self, numbers: NDArray[np.int64]) -> Times:
        """Times of edges by number, ns."""
        return self.first_ns + np.rint(numbers * self.period_ns).astype(np.int64)

    def made(self, until_ns: int) -> int:
        """How many edges there were up to and including a time."""
        number = max(0, int((until_ns - self.first_ns) / self.period_ns) + 2)
        while number > 0 and self.first_ns + round((number - 1) * self.period_ns) > until_ns:
            number -= 1
        return number if self.edges is None else min(number, self.edges)


@dataclass(frozen=True)
class Seen:
    """Edges as one device saw them: which edge of the line it was, the device's own number for it, and when; (n,) each.

    missed  (n,) bool: the device counted the edge, but has no row of it
    """

    edge: NDArray[np.int64]
    number: NDArray[np.int64]
    time: Times
    missed: NDArray[np.bool_]

    def __getitem__(self, rows: slice | NDArray[np.bool_]) -> Seen:
        return Seen(self.edge[rows], self.number[rows], self.time[rows], self.missed[rows])


def seen(line: TriggerLine, faults: Iterable[Fault], first: int, until: int, number: int) -> Seen:
    """Edges first ... until - 1 of the line as a device with these faults sees them.

    number: edges that the device has counted before.
    """
    edge = np.arange(first, until, dtype=np.int64)
    time = line.times(edge)
    for fault in faults:
        if isinstance(fault, ExtraEdge) and first <= fault.number < until:
            glitch = line.times(np.array([fault.number])) + round(fault.after * line.period_ns)
            place = int(np.searchsorted(time, glitch[0]))
            edge, time = np.insert(edge, place, fault.number), np.insert(time, place, glitch)
    true = time == line.times(edge)
    for fault in faults:
        if isinstance(fault, LostEdge):
            kept = ~(true & (edge >= fault.number) & (edge < fault.number + fault.count))
            edge, time, true = edge[kept], time[kept], true[kept]
    numbers = number + np.arange(len(edge), dtype=np.int64)
    missed = np.zeros(len(edge), bool)
    for fault in faults:
        if isinstance(fault, LostRow):
            missed |= (numbers >= fault.number) & (numbers < fault.number + fault.count)
    return Seen(edge, numbers, time, missed)
