"""A device's tick counter seen from the host: host time at a tick, from readings of both at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TRUSTED = 1.5  # times the shortest round trip
SLOWEST = 0.5  # of the ticks' pace: how slowly told time may pass
Reading = tuple[int, int, int]  # tick, host ns, round trip in ns


class TickClock:
    """Line through the best of the latest readings (tick, host ns): those whose round trip was hardly longer than the shortest one,
    for only they say when the tick was read. The nominal rate serves until they span ``settle`` seconds.

    A crystal is within 100 ppm of nominal; a reading's error is half its round trip. The stamps that the driver gives are as good
    as that; daq relates ``readings`` to the host's clock once more, over the whole run.
    """

    def __init__(self, nominal_hz: float, settle: float = 2.0, keep: int = 64) -> None:
        self._ns = 1e9 / nominal_hz
        self._settle, self._keep = settle, keep
        self._readings: list[Reading] = []
        self._begun = 0  # the first reading of the counter as it now runs
        self._told: tuple[int, int] | None = None  # the last tick whose host time was told, and that time

    def restart(self) -> None:
        """The counter has begun anew: earlier readings say nothing any more. Host times still never go back."""
        self._begun = len(self._readings)

    def add(self, tick: int, host: int, round_trip: int) -> None:
        """One reading: ``tick`` (64 bit), the host's ns halfway through the request, and its round trip in ns."""
        self._readings.append((tick, host, round_trip))

    def readings(self) -> list[tuple[int, int]]:
        """All readings, (tick, host ns), but for those that were answered late."""
        pieces = [self._readings[k : k + self._keep] for k in range(0, len(self._readings), self._keep)]
        return [(tick, host) for piece in pieces for tick, host, _ in _prompt(piece)]

    def host(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Host ns at ``ticks`` (n,), which rise from call to call; at least one reading must have been added.

        Host times rise with the ticks, too: where a better reading shows that those told so far were late, time goes on at half its
        pace until the line has caught up with them.
        """
        good = _prompt(self._readings[max(self._begun, len(self._readings) - self._keep) :])
        best = min(good, key=lambda reading: reading[2])
        x, y = (np.array([r[k] - best[k] for r in good], np.float64) for k in (0, 1))
        offset, slope = 0.0, self._ns
        if np.ptp(x) * self._ns > self._settle * 1e9:
            slope, offset = np.polyfit(x, y, 1)
        line = best[1] + np.rint((ticks - best[0]) * slope + offset).astype(np.int64)
        if self._told is not None:
            least = np.rint((ticks - self._told[0]) * (SLOWEST * self._ns)).astype(np.int64)
            line = np.maximum(line, self._told[1] + least)
        if len(line):
            self._told = int(ticks[-1]), int(line[-1])
        return line


def _prompt(readings: list[Reading]) -> list[Reading]:
    """Those whose round trip was hardly longer than the shortest."""
    shortest = min(trip for _, _, trip in readings)
    return [reading for reading in readings if reading[2] <= TRUSTED * shortest]
