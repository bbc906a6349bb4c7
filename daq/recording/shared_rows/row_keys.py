"""A row of measured values as one number, which is the same wherever and whenever the row is written."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array

GRID = 1e-7
"""rad, m, A: values are compared to this, finer than instruments resolve and coarser than texts round."""
MISSING = -(2.0**62)
"""In place of what is not finite."""

Keys = NDArray[np.uint64]


def row_keys(*signals: Array) -> Keys:
    """(n,) a hash of each row of the signals, (n, k) each: by random odd factors (Dietzfelbinger et al., 1997)."""
    columns = [column for one in signals for column in np.asarray(one, float).T]
    factors = np.random.default_rng(0).integers(2**63, size=len(columns), dtype=np.uint64) * np.uint64(2) + np.uint64(1)
    keys = np.zeros(len(signals[0]), np.uint64)
    for column, factor in zip(columns, factors):
        whole = np.rint(column / GRID)
        whole[~np.isfinite(whole)] = MISSING
        keys += whole.astype(np.int64).view(np.uint64) * factor
    return keys ^ (keys >> np.uint64(32))
