"""Time of the simulated rig: the wall's, or its own, which runs as fast as the host can compute."""

from __future__ import annotations

import time


class FastClock:
    """A host clock on which nothing takes time but ``sleep`` (drivers.protocols.HostClock).

    monotonic_ns starts at one second; wall_ns starts at the real time, so that recordings have the right date.
    """

    def __init__(self) -> None:
        self._now = 1_000_000_000
        self._offset = time.time_ns() - self._now

    def monotonic_ns(self) -> int:
        return self._now

    def wall_ns(self) -> int:
        return self._now + self._offset

    def sleep(self, seconds: float) -> None:
        self._now += max(0, round(seconds * 1e9))
