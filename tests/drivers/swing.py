"""A small motion known in closed form, on the terminals of the simulated devices."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.protocols import Block
from sim_backend.protocol.wires import TriggerLine, Wires

AMPLITUDE = 20_000.0  # counts


def counts(channel: int, at: NDArray[np.int64]) -> NDArray[np.int64]:
    """A sine of (channel + 1) / 4 Hz, another phase on each channel."""
    seconds = at * 1e-9
    return np.rint(AMPLITUDE * np.sin(2 * np.pi * (channel + 1) / 4 * seconds + channel)).astype(np.int64)


def volts(channel: int, at: NDArray[np.int64]) -> NDArray[np.float64]:
    """Likewise, 3 V, offset by a tenth of a volt a channel."""
    return 0.1 * channel + 3.0 * np.cos(2 * np.pi * (channel + 1) / 4 * at * 1e-9)


def points(at: NDArray[np.int64]) -> NDArray[np.float64]:
    """A circle of 0.4 m in the tracker's frame."""
    angle = 2 * np.pi * 0.5 * at * 1e-9
    return np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle), np.full(len(at), 1.5)], axis=1)


def swing_wires(trigger: TriggerLine | None = None) -> Wires:
    """Terminals of one device."""
    return Wires(counts=counts, volts=volts, points=points, trigger=trigger or TriggerLine())


def read_rows(read: Callable[[], Block], rows: int, seconds: float = 5.0) -> list[Block]:
    """Blocks until ``rows`` rows have come; fails after ``seconds``."""
    blocks: list[Block] = []
    deadline = time.monotonic() + seconds
    while sum(map(len, blocks)) < rows:
        assert time.monotonic() < deadline, f"{sum(map(len, blocks))} of {rows} rows in {seconds} s"
        blocks.append(read())
        time.sleep(0.002)
    return blocks
