"""A device's tick counter seen from the host: host time at a tick, from readings of both at once."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

TRUSTED = 1.5  # times the shortest round trip
SLOWEST = 0.5  # of the ticks' pace: how slowly told time may pass


class TickClock:
    """Line through the best of the latest readings (tick, host ns): those whose round trip was hardly longer than the shortest one,
    for only they say when the tick was read. The nominal rate serves until they span ``settle`` seconds.

    A crystal is within 100 ppm of nominal; a reading's error is half its round trip. The stamps that the driver gives are as good
    as that; daq relates the same ticks to the host's clock once more over the whole run.
    """

    def __init__(self, nominal_hz: float, settle: float = 2.0, keep: int = 64) -> None:
        self._ns = 1e9 / nominal_hz
        self._settle = settle
        self._readings: deque[tuple[int, int, int]] = deque(maxlen=keep)  # tick, host, round trip
        self._told: tuple[int, int] | None = None  # the last tick whose host time was told, and that time

    def restart(self) -> None:
        """The counter has begun anew: earlier readings say nothing any more. Host times still never go back."""
        self._readings.clear()

    def add(self, tick: int, host: int, round_trip: int) -> None:
        """One reading: ``tick`` (64 bit), the host's ns halfway through the request, and its round trip in ns."""
        self._readings.append((tick, host, round_trip))

    def host(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Host ns at ``ticks`` (n,), which rise from call to call; at least one reading must have been added.

        Host times rise with the ticks, too: where a better reading shows that those told so far were late, time goes on at half its
        pace until the line has caught up with them.
        """
        shortest = min(trip for _, _, trip in self._readings)
        good = [reading for reading in self._readings if reading[2] <= TRUSTED * shortest]
        best = next(reading for reading in good if reading[2] == shortest)
        x, y = (np.array([r[k] - best[k] for r in good], np.float64) for k in (0, 1))
        offset, slope = 0.0, self._ns
        if np.ptp(x) * self._ns > self._settle * 1e9:
            slope, offset = np.polyfit(x, y, 1)
        line = best[1] + np.rint((ticks - best[0]) * slope + offset).astype(np.int64)
        if self._told is not None:
            line = np.maximum(
                line, self._told[1] + np.rint((ticks - self._told[0]) * (SLOWEST * self._ns)).astype(np.int64)
            )
        if len(line):
            self._told = int(ticks[-1]), int(line[-1])
        return line
