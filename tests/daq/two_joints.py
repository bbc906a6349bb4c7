"""Rows of a rig with two joints, as a daemon publishes them."""

from __future__ import annotations

import numpy as np

from daq.acquisition.rows import Rows

JOINTS = ("shoulder", "elbow")


def rows(first: int, count: int, seed: int = 0, tracker: bool = True) -> Rows:
    """``count`` rows of random values with trigger numbers from ``first``."""
    random = np.random.default_rng([seed, first])
    number = np.arange(first, first + count)
    return Rows(
        number=number,
        host_ns=number * 1_000_000,
        wall_ns=number * 1_000_000 + 10**18,
        tick=number * 3,
        counts=random.integers(-(2**40), 2**40, (count, 3)),
        volts=random.normal(size=(count, 8)),
        quality=random.integers(0, 64, (count, 12)).astype(np.uint8),
        q=random.normal(size=(count, 2)),
        i=random.normal(size=(count, 2)),
        points=random.normal(size=(count, 3)) if tracker else None,
    )
