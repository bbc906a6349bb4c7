"""Edges of two square lines -> counts -> a register of finite width.

Forwards, line A leads: (A, B) goes 11, 10, 00, 01 over one line period. A decoder counts every edge of both lines (x4),
every edge of A (x2) or the rises of A (x1; taken back where A falls again backwards, as hostmot2 and every other sane
decoder does).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.protocols import CounterMode

Counts = NDArray[np.int64]

PER_LINE = {CounterMode.X1: 1, CounterMode.X2: 2, CounterMode.X4: 4}
"""Counts a line period."""

_PLACE = np.array([2, 3, 1, 0])  # position within the line period of the levels 2 A + B = 0, 1, 2, 3


def count(passed_a: Counts, passed_b: Counts, mode: CounterMode) -> Counts:
    """Counts from the edges that lines A and B are past (``sine_encoder``), any shape.

    0 in the first quarter of period 0.
    """
    if mode is CounterMode.X4:
        return passed_a + passed_b
    if mode is CounterMode.X2:
        return passed_a
    return passed_a >> 1


def levels(passed: Counts) -> NDArray[np.bool_]:
    """Level of a line: high past an even edge."""
    return (passed & 1) == 0


def decode(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> tuple[Counts, NDArray[np.bool_]]:
    """What an x4 decoder clocked once a row makes of the levels (m, ...) of its two lines.

    Counts from row 0 on, and errors.

    A row in which both lines changed at once is a quadrature error: its direction cannot be known, and it counts
    nothing.
    """
    place = _PLACE[2 * a.astype(np.int64) + b]
    step = np.diff(place, axis=0, prepend=place[:1]) & 3
    error = step == 2
    return np.cumsum(np.where(error, 0, np.where(step == 3, -1, step)), axis=0), error


def wrap(counts: Counts, bits: int | NDArray[np.int64]) -> Counts:
    """The low ``bits`` bits, unsigned: what a register shows."""
    return counts & ((np.int64(1) << np.asarray(bits, np.int64)) - 1)
