"""Counter channels: which there are, and counts of a register of finite width, extended to 64 bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault

FASTEST_STOP = 6400.0
"""counts/s: no joint that turns so fast stands still at count 0 ``ROW_NS`` later."""
ROW_NS = 10_000_000


def extend(raw: NDArray[np.int64], width: int, last: int) -> NDArray[np.int64]:
    """Extends register values to a continuous signed count.

    raw    (n,) int64: register values, any integers; only the low ``width`` bits are looked at
    width  bits of the register
    last   the extended count of the row before raw[0]

    Returns (n,) int64. Right as long as the count moves by less than half the register's range between two rows: at 24
    bit, 8.4 million counts. A jump of that size or more is not wrap but a fault, and is seen as an impossible speed.
    """
    if len(raw) == 0:
        return np.empty(0, np.int64)
    half = np.int64(1) << (width - 1)
    mask = (np.int64(1) << width) - 1
    steps = np.empty_like(raw)
    steps[0] = raw[0] - last
    np.subtract(raw[1:], raw[:-1], out=steps[1:])
    return last + np.cumsum(((steps + half) & mask) - half)


@dataclass
class ZeroAfterMotion:
    """What the last rows of a counter say where it shows 0, as it does once it has lost its power.

    Not found: a counter that lost its power within a row of 0 while its joint turned slower than ``FASTEST_STOP``.
    """

    count: int = 0
    at: int = 0
    speed: float = 0.0
    """counts/s, of the last two rows that were not both 0"""
    stopping_ns: int = 0
    """in which it stopped, where the last row is the first at 0"""

    def lost_power(self, count: int, now: int) -> bool:
        """Whether the row at ``now`` (ns) with the raw, signed ``count`` shows exactly 0 sooner than a joint stops.

        That is a fall to 0 from afar, or a second row at 0 of a counter that was turning. Takes the row in.
        """
        elapsed = max(now - self.at, ROW_NS)
        speed = abs(count - self.count) * 1e9 / elapsed
        if count:
            fell = stopped = False
            self.speed = speed
        else:
            fell = speed > FASTEST_STOP
            stopped = self.count == 0 and self.speed > FASTEST_STOP * self.stopping_ns / ROW_NS
            if self.count == 0:
                self.speed = 0.0
            self.stopping_ns = elapsed
        self.count, self.at = count, now
        return fell or stopped


def check_channel(device: str, channel: int, channels: int) -> None:
    """DeviceFault where a device has no such channel."""
    if not 0 <= channel < channels:
        has = f"0 to {channels - 1}" if channels > 1 else "only 0"
        raise DeviceFault(device, f"has no channel {channel}; it has {has}")
