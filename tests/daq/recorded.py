"""Random rows, for tests that record them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.acquisition.rows import Rows
from daq.recording.recorder import rows_layout

JOINTS, COUNTERS, INPUTS = 3, 2, 4
LAYOUT = rows_layout(
    [f"joint{j}" for j in range(1, JOINTS + 1)],
    counters=["c1", "c2"],
    inputs=["v1", "v2", "v3", "v4"],
    tracker=True,
    demand=True,
    effort=[1.0, 2.0, 3.0],
)
START_NS = 1_700_000_000 * 10**9
COLUMNS = {
    "number": "number",
    "wall_ns": "wall_ns",
    "host_ns": "host_ns",
    "tick": "tick",
    "counts": "counts",
    "volts": "volts",
    "quality": "quality",
    "q": "q",
    "i": "i",
    "qref": "qref",
    "points": "points",
}
"""Field of a Recording -> field of Rows."""


def make_rows(first: int, count: int, seed: int = 0) -> Rows:
    """``count`` rows of random values at about 1 kHz, with trigger numbers from ``first``.

    Row k depends on k and seed only.
    """
    number = np.arange(first, first + count)
    random = _noise(number[:, None] * 64 + np.arange(64), seed)
    return Rows(
        number=number,
        host_ns=5 * 10**12 + number * 1_000_000,
        wall_ns=START_NS + number * 1_000_000 + (random[:, 0] * 1000).astype(np.int64),
        tick=number * 7,
        counts=((random[:, 1:3] - 0.5) * 2.0**62).astype(np.int64),
        volts=random[:, 3:7] * 20 - 10,
        quality=(random[:, 7:14] * 64).astype(np.uint8),
        q=random[:, 14:17] * 6 - 3,
        i=np.where(random[:, 17:20] < 0.1, np.nan, random[:, 20:23] * 9),
        points=random[:, 23:26],
        qref=random[:, 26:29] * 6 - 3,
    )


def _noise(index: np.ndarray, seed: int) -> np.ndarray:
    """Numbers in [0, 1) that look random (splitmix64 of the index)."""
    x = index.astype(np.uint64) + np.uint64((seed + 1) * 0x9E3779B97F4A7C15 % 2**64)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (x ^ (x >> np.uint64(31))).astype(np.float64) / 2.0**64


def join(blocks: Sequence[Rows], name: str) -> np.ndarray:
    """One column of all blocks."""
    return np.concatenate([getattr(block, name) for block in blocks])
