"""Fewer points of a long series, with every peak kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array

POINTS = 2000
"""Of a line or a cloud in a page: about two for each column of pixels."""


def rows_per_bucket(rows: int, most: int = POINTS) -> int:
    """Neighbouring rows of which two are kept; 1: all are."""
    return 1 if rows <= most else -(-2 * rows // most)


def extremes(y: Array, every: int) -> NDArray[np.intp]:
    """Indices, in order, of the lowest and the highest value among every ``every`` rows; NaN only where all are."""
    if every <= 1:
        return np.arange(len(y))
    whole = np.full(-(-len(y) // every) * every, np.nan)
    whole[: len(y)] = y
    buckets = whole.reshape(-1, every)
    first = np.arange(len(buckets)) * every
    low = np.where(np.isnan(buckets), np.inf, buckets).argmin(axis=1)
    high = np.where(np.isnan(buckets), -np.inf, buckets).argmax(axis=1)
    pairs = np.sort(np.column_stack([first + low, first + high]), axis=1)
    return np.minimum(pairs, len(y) - 1).ravel()


def envelope(y: Array, every: int) -> tuple[NDArray[np.intp], Array]:
    """The same two values of each bucket of ``every`` rows of y (m,), at rows that do not depend on them: both ends.

    Several series of the same rows so keep one x axis; a peak is drawn less than a bucket from where it is.
    """
    if every <= 1:
        return np.arange(len(y)), y
    kept = extremes(y, every)
    first = np.arange(0, len(y), every)
    last = np.minimum(first + every - 1, len(y) - 1)
    return np.column_stack([first, last]).ravel(), y[kept]
