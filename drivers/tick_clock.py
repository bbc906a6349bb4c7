"""A device's tick counter seen from the host: host time at a tick, from readings of both at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CRYSTAL = 100e-6  # how far a crystal may be from its nominal rate (standard deviation)
JITTER = 0.1  # of the shortest round trip: what a reading is off, however quick it was
KEPT = 64  # readings of which the quick ones are kept
PROMPT = 1.5  # times the shortest round trip
SLOWEST = 0.5  # of the ticks' pace: the slowest that reported time may pass
Reading = tuple[int, int, int]  # tick, host ns, round trip in ns


class TickClock:
    """Line through the latest readings (tick, host ns), each weighted by how quick it was.

    What it took longer than the quickest one was spent in either direction, so the error is at most half of that. The
    rate begins as the nominal one, known to ``CRYSTAL``; how soon the readings overrule it follows from both
    uncertainties (least squares).

    daq relates ``readings`` to the host's clock once more, over the whole run.
    """

    def __init__(self, nominal_hz: float) -> None:
        self._ns = 1e9 / nominal_hz
        self._readings: list[Reading] = []
        self._begun = 0  # the first reading of the counter as it now runs
        self._line: tuple[Reading, float, float] | None = None  # quickest reading, offset (ns) and ns a tick there
        self._told: tuple[int, int] | None = None  # the last tick whose host time was reported, and that time

    def restart(self) -> None:
        """The counter has begun anew: earlier readings say nothing any more. Host times still never go back."""
        self._begun = len(self._readings)

    def add(self, tick: int, host: int, round_trip: int) -> None:
        """One reading: ``tick`` (64 bit), the host's ns halfway through the request, and its round trip in ns."""
        self._readings.append((tick, host, round_trip))
        self._line = None

    def readings(self) -> list[tuple[int, int]]:
        """The quick ones of all readings, (tick, host ns): a quarter of them at least."""
        pieces = [self._readings[k : k + KEPT] for k in range(0, len(self._readings), KEPT)]
        return [(tick, host) for piece in pieces for tick, host, _ in _quick(piece)]

    @property
    def quickest(self) -> int:
        """ns: the shortest round trip of all readings."""
        return min(trip for _, _, trip in self._readings)

    def tick(self, host: int) -> int:
        """The tick at host ns ``host``, by the line of ``host()``."""
        (tick, at, _), offset, slope = self._line = self._line or self._fitted()
        return tick + round((host - at - offset) / slope)

    def host(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Host ns at ``ticks`` (n,), which rise from call to call; at least one reading must have been added.

        Host times rise with the ticks, too: where a better reading shows that earlier ones were late, time goes on at
        half its pace until the line has caught up with them.
        """
        (tick, host, _), offset, slope = self._line = self._line or self._fitted()
        line = host + np.rint((ticks - tick) * slope + offset).astype(np.int64)
        if self._told is not None:
            least = np.rint((ticks - self._told[0]) * (SLOWEST * self._ns)).astype(np.int64)
            line = np.maximum(line, self._told[1] + least)
        if len(line):
            self._told = int(ticks[-1]), int(line[-1])
        return line

    def _fitted(self) -> tuple[Reading, float, float]:
        latest = self._readings[max(self._begun, len(self._readings) - KEPT) :]
        best = min(latest, key=lambda reading: reading[2])
        tick, host, trip = (np.array([r[k] - best[k] for r in latest], np.float64) for k in range(3))
        passed = tick * self._ns
        sigma = 1.0 + JITTER * best[2] + 0.5 * trip
        # Unknown are the offset and the rate's deviation from nominal; the last row says how large that is likely to
        # be.
        rows = np.vstack([np.column_stack([1 / sigma, passed / sigma]), [0.0, 1 / CRYSTAL]])
        (offset, deviation), *_ = np.linalg.lstsq(rows, np.append((host - passed) / sigma, 0.0), rcond=None)
        return best, float(offset), self._ns * (1 + float(deviation))


def _quick(readings: list[Reading]) -> list[Reading]:
    """Those whose round trip was hardly longer than the shortest, and a quarter at least; in order."""
    trips = sorted(trip for _, _, trip in readings)
    longest = max(PROMPT * trips[0], trips[(len(trips) - 1) // 4])
    return [reading for reading in readings if reading[2] <= longest]
