"""Counter channels: which there are, and counts of a register of finite width, extended to 64 bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault

FASTEST_STOP = 6400.0
"""counts/s: no joint that turns so fast stands still at count 0 one row later."""


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


def fell_to_zero(count: int, last: int, elapsed_ns: int) -> bool:
    """Whether a counter may have lost its power between two rows.

    It shows exactly 0, and came there faster than an arm stops.

    count, last  raw counts of this row and of the one before it, signed
    elapsed_ns   between them

    A counter that was within ``FASTEST_STOP`` of 0 is not found out by this.
    """
    return count == 0 and abs(last) > FASTEST_STOP * max(elapsed_ns, 10_000_000) * 1e-9


def check_channel(device: str, channel: int, channels: int) -> None:
    """DeviceFault where a device has no such channel."""
    if not 0 <= channel < channels:
        has = f"0 to {channels - 1}" if channels > 1 else "only 0"
        raise DeviceFault(device, f"has no channel {channel}; it has {has}")
