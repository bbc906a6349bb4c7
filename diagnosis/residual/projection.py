"""What is left of columns beside others that are free."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array

DEPENDENT = 1e-5
"""Relative length below which what is left of a column beside others is rounding."""


def orthonormal_basis(columns: Array) -> Array:
    """(N, r) orthonormal basis of columns (N, k)."""
    size = np.linalg.norm(columns, axis=0)
    basis, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.asarray(basis[:, values > DEPENDENT * values.max(initial=0.0)])


def orthogonal_to(basis: Array, values: Array) -> Array:
    """Values (m, n) or (m, n, k) perpendicular to a basis (m n, r); exactly 0 where nothing is left of them."""
    flat = values.reshape(len(basis), -1)
    residual = flat - basis @ (basis.T @ flat)
    independent = np.linalg.norm(residual, axis=0) > DEPENDENT * np.linalg.norm(flat, axis=0)
    return np.asarray((residual * independent).reshape(values.shape))
