"""CORE_TIMER, the T7's own clock, which stamps every scan: extended to 64 bit and related to the host's clock.

It is read when a stream begins and every quarter of a second from then on. The T7 took a value at some instant between
request and answer: where a busy computer or network holds these up for milliseconds, the reading is as uncertain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.counting import extend
from drivers.labjack_t7 import protocol as t7
from drivers.labjack_t7.link import T7Link
from drivers.protocols import EdgeSource, HostClock, Plan
from drivers.tick_clock import PROMPT, Reading, TickClock

READING_PERIOD = 250_000_000  # ns between readings, which also feed the watchdog
READINGS = 16  # at most when a stream begins: the quickest counts


class CoreTimer:
    """The timer of one acquisition. ``interval`` ns between triggers, as planned."""

    def __init__(self, link: T7Link, clock: HostClock, plan: Plan) -> None:
        self.interval = 1e9 / plan.rate
        self._link, self._clock = link, clock
        self._own = plan.source == EdgeSource.TIMER
        self._ticks = TickClock(t7.CORE_TIMER_HZ)
        self._base = 0  # raw value at tick 0
        self._tick = link.read_uint(t7.CORE_TIMER)  # ticks are 64 bit from here on, and positive

    def extend(self, raw: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) ticks of scans in order, n > 0, from their 32 bits."""
        tick = extend(raw - self._base, 32, self._tick)
        self._tick = int(tick[-1])
        return tick

    def host(self, tick: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) host ns at ticks (n,)."""
        return self._ticks.host(tick)

    def readings(self) -> list[tuple[int, int]]:
        """(tick, host ns) of the readings since arming; late answers left out."""
        return self._ticks.readings()

    def read_if_due(self, now: int) -> None:
        """One reading where the last is a quarter of a second old at host ns ``now``. Raises OSError."""
        if now - self._read_at > READING_PERIOD:
            self._add(self._reading())

    def read_quickly(self) -> None:
        """One reading that is known as well as the link allows, for a stream that begins. Raises OSError."""
        self._add(self._quick_reading())

    def begin_anew(self) -> None:
        """The T7 has lost its power, its timer is at 0: ticks go on from where they would now be, by the host's clock.

        Raises OSError where the T7 answers too slowly to say which trigger a row belongs to.
        """
        raw, host, trip = self._quick_reading()
        if trip > self._longest_trip():
            raise OSError(
                f"it has restarted, and answers after {trip * 1e-6:.2g} ms: too late to tell which of the triggers, "
                f"{self.interval * 1e-6:.2g} ms apart, makes a row"
            )
        self._tick = self._ticks.tick(host)
        self._base = raw - self._tick
        self._ticks.restart()
        self._ticks.add(self._tick, host, trip)

    def _reading(self) -> Reading:
        """The timer as the T7 has it, the host's ns halfway through the request, and its round trip in ns."""
        before = self._clock.monotonic_ns()
        raw = self._link.read_uint(t7.CORE_TIMER)
        self._read_at = self._clock.monotonic_ns()
        return raw, (before + self._read_at) // 2, self._read_at - before

    def _quick_reading(self) -> Reading:
        """The quickest of some readings; the first that is known to a quarter of an interval ends the search.

        Times of the stream's first rows rest on it alone, and after a restart their numbers: an answer held up for 8 ms
        would shift rows by two at 500 rows/s.
        """
        best = self._reading()
        for _ in range(READINGS - 1):
            if best[2] <= self.interval / 2:
                break
            best = min(best, self._reading(), key=lambda reading: reading[2])
        return best

    def _add(self, reading: Reading) -> None:
        raw, host, trip = reading
        tick = extend(np.array([raw - self._base], np.int64), 32, self._tick)
        self._ticks.add(int(tick[0]), host, trip)

    def _longest_trip(self) -> float:
        """ns that the reading after a restart may take.

        The triggers of a line have gone on meanwhile: half an interval makes their number certain. Where the T7's own
        timer makes the rows, their grid begins anew; only their times rest on the reading, as those before did.
        """
        half = self.interval / 2
        return max(half, PROMPT * self._ticks.quickest) if self._own else half
