"""Counter channels: which there are, and counts of a register of finite width, extended to 64 bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault


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


def check_channel(device: str, channel: int, channels: int) -> None:
    """DeviceFault where a device has no such channel."""
    if not 0 <= channel < channels:
        has = f"0 to {channels - 1}" if channels > 1 else "only 0"
        raise DeviceFault(device, f"has no channel {channel}; it has {has}")
