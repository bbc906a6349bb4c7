"""Blocks put together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.protocols import Block, Quality


def empty(counters: int = 0, inputs: int = 0, *, points: bool = False, readings: int = 0) -> Block:
    """A block of no rows."""
    none = np.empty(0, np.int64)
    return Block(
        none,
        none,
        none,
        np.empty((0, counters + inputs + points), np.uint8),
        np.empty((0, counters), np.int64) if counters else None,
        np.empty((0, inputs)) if inputs else None,
        np.empty((0, 3)) if points else None,
        np.empty((0, readings)) if readings else None,
    )


def join(
    blocks: Sequence[Block], counters: int = 0, inputs: int = 0, *, points: bool = False, readings: int = 0
) -> Block:
    """The rows of all blocks, in order; each has the columns named here."""
    if len(blocks) == 1:
        return blocks[0]
    if not blocks:
        return empty(counters, inputs, points=points, readings=readings)

    def all_of(column: str) -> np.ndarray:
        return np.concatenate([getattr(block, column) for block in blocks])

    return Block(
        all_of("number"),
        all_of("host"),
        all_of("tick"),
        all_of("quality"),
        all_of("counts") if counters else None,
        all_of("volts") if inputs else None,
        all_of("points") if points else None,
        all_of("readings") if readings else None,
    )


def one_row(
    host: int,
    counts: Sequence[int] | None = None,
    volts: Sequence[float] | None = None,
    quality: Sequence[int] = (),
) -> Block:
    """What ``poll`` returns: one row without a number."""
    return Block(
        np.array([-1]),
        np.array([host], np.int64),
        np.zeros(1, np.int64),
        np.array([quality], np.uint8),
        None if counts is None else np.array([counts], np.int64),
        None if volts is None else np.array([volts], np.float64),
    )


def missing_row(host: int, counters: int, inputs: int, flags: Quality = Quality.MISSING) -> Block:
    """A row without any value: 0 counts, NaN, each marked."""
    return one_row(
        host,
        [0] * counters if counters else None,
        [float("nan")] * inputs if inputs else None,
        [int(flags)] * (counters + inputs),
    )
