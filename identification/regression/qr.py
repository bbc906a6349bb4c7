"""R of a QR decomposition: all that least squares has to know of its rows. The orthogonal factor is never made."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from arm_io.types import Array

PANEL = 8
"""Columns that are reflected one by one before the others follow."""


def triangle_of(rows: Array, *, overwrite: bool = False) -> Array:
    """(min(r, p), p) upper triangle with the inner products of the columns of ``rows`` (r, p).

    LAPACK's compact-WY routine with narrow panels: on 1185 x 84 rows it takes 0.52 ms where the one behind numpy's and
    scipy's ``qr`` takes 1.26 ms (OpenBLAS, one thread), and a few hundred rows take less than these wrappers do.
    """
    if not rows.size:
        return np.zeros((min(rows.shape), rows.shape[1]))
    tall = rows.shape[0] > 1.5 * rows.shape[1]
    if tall:
        factor = lapack.dgeqrt(min(PANEL, *rows.shape), rows, overwrite_a=overwrite)[0]
    else:
        factor = lapack.dgeqrf(rows, overwrite_a=overwrite)[0]
    factor = factor[: rows.shape[1]]
    return np.asarray(factor * _upper(*factor.shape))


def pivoted_triangle(rows: Array) -> tuple[Array, NDArray[np.intp]]:
    """R (min(r, p), p) with its diagonal falling, and which column of ``rows`` (r, p) each of its columns is."""
    if not rows.size:
        return np.zeros((min(rows.shape), rows.shape[1])), np.arange(rows.shape[1])
    factor, turned = lapack.dgeqp3(rows)[:2]
    factor = factor[: rows.shape[1]]
    return np.asarray(factor * _upper(*factor.shape)), np.asarray(turned - 1, np.intp)


@cache
def _upper(rows: int, columns: int) -> Array:
    return np.triu(np.ones((rows, columns)))
