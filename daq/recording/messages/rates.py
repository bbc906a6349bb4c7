"""Speeds of joints from their positions, as viewers show them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def rates(q: NDArray[np.float64], wall_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, J) speeds of positions q (n, J) at times wall_ns (n,), per s: slopes of the parabola through three rows.

    Those are the row and its neighbours, at both ends the outermost three: no row is early or late. Of two rows the
    difference quotient; of one row, and where two rows have one time, NaN or infinite.
    """
    if len(q) < 2:
        return np.full_like(q, np.nan, float)
    seconds = (wall_ns - wall_ns[0]) * 1e-9
    with np.errstate(all="ignore"):
        return np.asarray(np.gradient(q, seconds, axis=0, edge_order=2 if len(q) > 2 else 1))
