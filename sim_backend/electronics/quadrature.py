"""Edges of two square lines -> counts -> a register of finite width.

Forwards, line A leads: (A, B) goes 11, 10, 00, 01 over one line period. A decoder counts every edge of both lines (x4),
every edge of A (x2) or the rises of A (x1; taken back where A falls again backwards, as LinuxCNC's hostmot2 does).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.protocols import CounterMode

Counts = NDArray[np.int64]


def count(passed_a: Counts, passed_b: Counts, mode: CounterMode) -> Counts:
    """Counts from the number of edges that lines A and B have passed (``sine_encoder``), any shape.

    The count is 0 in the first quarter of period 0.
    """
    if mode is CounterMode.X4:
        return passed_a + passed_b
    if mode is CounterMode.X2:
        return passed_a
    return passed_a >> 1


def wrap(counts: Counts, bits: int | NDArray[np.int64]) -> Counts:
    """The low ``bits`` bits, unsigned: what a register shows."""
    return counts & ((np.int64(1) << np.asarray(bits, np.int64)) - 1)
