"""Least squares with columns of unit length, so that units do not decide which directions count as dependent."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array


def scaled(columns: Array) -> tuple[Array, Array]:
    """Columns (m, k) of unit length, and the lengths (k,) that they had; a column of zeros keeps length 1."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return columns / size, size


def scaled_lstsq(columns: Array, y: Array, independent: float = 1e-9) -> Array:
    """(k,) least-squares coefficients of ``columns`` (m, k) for y (m,), of least norm where they are dependent.

    (k, r) for y (m, r).

    independent: relative singular value of the scaled columns below which a direction is dependent.
    """
    x, size = scaled(columns)
    return np.asarray(np.linalg.lstsq(x, y, rcond=independent)[0].T / size, float).T
