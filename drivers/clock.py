"""The host's own clocks, as the sampler sees them."""

from __future__ import annotations

import time


class SystemClock:
    """CLOCK_MONOTONIC, CLOCK_REALTIME and a plain sleep (drivers.protocols.HostClock)."""

    def monotonic_ns(self) -> int:
        return time.monotonic_ns()

    def wall_ns(self) -> int:
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)
