"""Slope of a residual over a column, joint by joint, with the std that residuals correlated within a block leave it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array

Rows = tuple[Array, Array, NDArray[np.intp]]
"""Of a recording: column (m, n) and residual (m, n), both over the std of a row, and the block (m,) of each row."""


def slope_by_blocks(recordings: Iterable[Rows]) -> tuple[Array, Array]:
    """(n,) each: the slope by least squares over all recordings, and its std; NaN at a joint whose column is 0."""
    every = list(recordings)
    size = np.sum([np.sum(x**2, axis=0) for x, _, _ in every], axis=0)
    size[size == 0.0] = np.nan
    slope = np.sum([np.sum(x * y, axis=0) for x, y, _ in every], axis=0) / size
    square = np.zeros_like(slope)
    for x, y, block in every:
        scores = np.nan_to_num(x * (y - x * slope))
        square += np.sum([np.bincount(block, column) ** 2 for column in scores.T], axis=1)
    return slope, np.sqrt(square) / size
