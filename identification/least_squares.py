"""Ordinary, weighted and robust least squares of W beta = y.

ols    every row alike
wls    rows of a joint divided by the standard deviation of that joint's residual in ols (Gautier, 1997)
irls   wls, and rows far off the model weighted down by Tukey's biweight (Holland & Welsch, 1977)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]
Joints = NDArray[np.intp]
Method = Literal["ols", "wls", "irls"]

BIWEIGHT = 4.685  # Tukey's tuning constant: 95 % efficient on Gaussian residuals
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class Fit:
    """values (b,); weight (rows,) by which each row was multiplied; residual (rows,) = y - W values, N m or N;
    condition number of the weighted W with its columns scaled to unit norm."""

    values: Array
    weight: Array
    residual: Array
    condition: float


def least_squares(columns: Array, y: Array, joint: Joints, method: Method = "wls", *, iterations: int = 20) -> Fit:
    """Fits y (rows,) by columns (rows, b); ``joint`` (rows,) says which equation each row is of."""
    if method == "ols":
        return weighted(columns, y, np.ones(len(y)))
    # Once: iterated, the joint with the most parameters of its own would draw all weight to itself.
    fit = _weighted_by_joint(columns, y, joint)
    if method == "wls":
        return fit
    for _ in range(iterations):
        before = fit.values
        spread = joint_noise(fit.residual, joint, robust=True)[joint]
        inside = np.clip(1 - (fit.residual / (BIWEIGHT * spread)) ** 2, 0.0, None)
        fit = weighted(columns, y, inside / spread)  # the square root of Tukey's weight (1 - u^2)^2
        if np.allclose(fit.values, before, rtol=1e-6, atol=1e-9):
            break
    return fit


def weighted(columns: Array, y: Array, weight: Array) -> Fit:
    """Least squares of weight * (y - columns beta) by a QR decomposition of the scaled columns."""
    values, triangle = _solved(_triangle(np.column_stack([columns, y]) * weight[:, None]))
    return Fit(values, weight, y - columns @ values, float(np.linalg.cond(triangle)))


def _weighted_by_joint(columns: Array, y: Array, joint: Joints) -> Fit:
    """Least squares with the rows of a joint over their noise in ordinary least squares.

    Each joint's rows are reduced to a triangle once; the noise, and both fits, come from these.
    """
    both = np.column_stack([columns, y])
    parts, rows = [], np.bincount(joint)
    for j in np.flatnonzero(rows):
        parts.append(both[joint == j])
        if len(parts[-1]) > both.shape[1]:
            parts[-1] = _triangle(parts[-1])
    values, _ = _solved(_triangle(np.concatenate(parts)))
    left = [np.linalg.norm(part @ np.append(values, -1.0)) for part in parts]
    noise = np.ones(len(rows))
    noise[rows > 0] = left / np.sqrt(rows[rows > 0])
    noise = _floored(noise)
    parts = [part / noise[j] for part, j in zip(parts, np.flatnonzero(rows))]
    values, triangle = _solved(_triangle(np.concatenate(parts)))
    return Fit(values, 1.0 / noise[joint], y - columns @ values, float(np.linalg.cond(triangle)))


def _triangle(both: Array) -> Array:
    """R of the QR decomposition of (rows, b + 1); the orthogonal factor is never made."""
    return np.asarray(linalg.qr(both, mode="r", check_finite=False, overwrite_a=True)[0][: both.shape[1]])


def _solved(triangle: Array) -> tuple[Array, Array]:
    """values (b,) from the triangle of [columns y], and that of the columns with each scaled to unit norm.

    Least norm, so scaled, where a direction is in no row.
    """
    count = triangle.shape[1] - 1
    r, right = triangle[:count, :count], triangle[:count, count]
    scale = np.linalg.norm(r, axis=0)
    scale[scale == 0] = 1.0
    r = r / scale
    diagonal = np.abs(np.diag(r))
    if len(r) < count or diagonal.min(initial=1.0) < 1e-13:
        return np.linalg.lstsq(r, right, rcond=1e-13)[0] / scale, r
    return linalg.solve_triangular(r, right, check_finite=False) / scale, r


def joint_noise(residual: Array, joint: Joints, *, robust: bool = False) -> Array:
    """(J,) standard deviation of each joint's residual; ``robust``: from the median of its magnitude."""
    noise = np.ones(int(joint.max()) + 1 if len(joint) else 0)
    for j in np.unique(joint):
        rows = residual[joint == j]
        noise[j] = MAD_TO_SIGMA * np.median(np.abs(rows)) if robust else np.sqrt(np.mean(rows**2))
    return _floored(noise)


def _floored(noise: Array) -> Array:
    return np.asarray(np.maximum(noise, 1e-12 * max(1.0, noise.max(initial=0.0))))


def relative_error(y: Array, residual: Array) -> float:
    """norm(residual) / norm(y): the contract's measure, over rows as they are (no weights)."""
    return float(np.linalg.norm(residual) / np.linalg.norm(y)) if len(y) else float("nan")
