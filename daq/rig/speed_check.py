"""Speed of the joints between values of known time, over times in which encoder steps do not matter.

A device that was silent for a while then shows where the joint is now: that distance belongs to the whole gap, not to
the last row.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array

SHORTEST_NS = 5_000_000
"""ns over which a speed is measured at least: the steps of an encoder are no speed."""
ROWS = 5
"""Rows that a speed is taken over at least: the stamps of polled devices lie unevenly."""
LATE_NS = 1_000_000_000
"""After so long without a value of known time one of unknown time has to do, if it shows that the joint has moved."""


class SpeedCheck:
    """Mean speed of each joint since its reference, the last value that it was taken from.

    limit      (J,) rad/s (m/s)
    period_ns  of the rows
    units      (J,) rad or m
    """

    def __init__(self, limit: Array, period_ns: float, units: Sequence[str]) -> None:
        self.limit, self.units = limit, units
        self._shortest = max(SHORTEST_NS, round(ROWS * period_ns))
        self._position = np.full(len(limit), np.nan)
        self._host = np.full(len(limit), -1, np.int64)

    def too_fast(
        self, position: Array, measured: NDArray[np.bool_], timed: NDArray[np.bool_], host_ns: NDArray[np.int64]
    ) -> str | None:
        """The first joint that was seen to go faster than its limit, as a sentence; None if none was.

        position  (n, J) rad (m); measured: (n, J) where it is a value; timed: (n, J) where that was taken at
                  ``host_ns`` (n,)
        """
        if self._host.max() >= host_ns[0]:  # time went back: another run
            self._host[:] = -1
        self._begin(position, measured & timed, host_ns)
        return self._judge(position, measured & timed, host_ns, 0) or self._judge(
            position, measured & ~timed, host_ns, LATE_NS
        )

    def _begin(self, position: Array, usable: NDArray[np.bool_], host_ns: NDArray[np.int64]) -> None:
        """The first value of a joint is its first reference."""
        new = np.flatnonzero((self._host < 0) & usable.any(axis=0))
        row = np.argmax(usable[:, new], axis=0)
        self._position[new], self._host[new] = position[row, new], host_ns[row]

    def _judge(self, position: Array, usable: NDArray[np.bool_], host_ns: NDArray[np.int64], wait: int) -> str | None:
        """Judges the last usable value of each joint; a sentence for a joint above its limit, else None.

        ``wait`` > 0 is for values whose time is not known: they are judged only ``wait`` ns after the last judged
        value, and only if the joint has moved.
        """
        last = len(usable) - 1 - np.argmax(usable[::-1], axis=0)
        now = position[last, np.arange(len(last))]
        passed = host_ns[last] - self._host
        moved = np.abs(now - self._position)
        due = usable.any(axis=0) & (self._host >= 0) & (passed >= max(self._shortest, wait))
        if wait:
            due &= moved > 0
        for joint in np.flatnonzero(due & ~(moved <= self.limit * passed * 1e-9)).tolist():
            speed = moved[joint] / (passed[joint] * 1e-9)
            unit = f"{self.units[joint]}/s"
            return f"joint {joint + 1} at {speed:.4g} {unit}, limit {self.limit[joint]:g} {unit}"
        self._position[due], self._host[due] = now[due], host_ns[last][due]
        return None
