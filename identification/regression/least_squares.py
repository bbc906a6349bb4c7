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
from scipy.linalg import lapack

from arm_io.types import Array
from identification.regression.qr import triangle_of
from identification.selection import MAD_TO_STD

Joints = NDArray[np.intp]
Method = Literal["ols", "wls", "irls"]

REWEIGHTED = 20
"""Times, at most."""
BIWEIGHT = 4.685
"""Tukey's tuning constant: 95 % efficient on Gaussian residuals."""


@dataclass(frozen=True)
class Fit:
    """values (b,); weight (rows,) by which each row was multiplied; residual (rows,) = y - W values, N m or N.

    scaled (r, b): the weighted W with its columns scaled to unit norm, as a triangle with the same singular values.
    """

    values: Array
    weight: Array
    residual: Array
    scaled: Array

    @property
    def condition(self) -> float:
        """Condition number of the weighted W with its columns scaled to unit norm; NaN where ``scaled`` is empty."""
        return float(np.linalg.cond(self.scaled)) if self.scaled.size else float("nan")


def least_squares(columns: Array, y: Array, joint: Joints, method: Method = "wls") -> Fit:
    """Fits y (rows,) by columns (rows, b); ``joint`` (rows,) says which equation each row is of."""
    if method == "ols":
        return weighted(columns, y, np.ones(len(y)))
    # Not iterated: the joint with most parameters of its own would get more weight each time.
    fit = weighted_by_joint(columns, y, joint, joint_triangles(columns, y, joint))
    if method == "wls":
        return fit
    for _ in range(REWEIGHTED):
        before = fit.values
        spread = joint_noise(fit.residual, joint, robust=True)[joint]
        inside = np.clip(1 - (fit.residual / (BIWEIGHT * spread)) ** 2, 0.0, None)
        fit = weighted(columns, y, inside / spread)  # the square root of Tukey's weight (1 - u^2)^2
        if np.allclose(fit.values, before, rtol=1e-6, atol=1e-9):
            break
    return fit


def regularised(
    columns: Array, y: Array, joint: Joints, method: Method, prior: tuple[Array, Joints, Array] | None
) -> tuple[Fit, Array | None]:
    """``least_squares`` with further rows of value 0, and these rows as they were weighted; without any, None.

    prior: rows (r, b) in units of their own standard deviation, the joints (r,) that they are of, and the noise (J,) of
    each joint's rows.
    """
    if prior is None:
        return least_squares(columns, y, joint, method), None
    rows, of, noise = prior
    size = noise[of][:, None]
    both = least_squares(
        np.concatenate([columns, rows * size]),
        np.concatenate([y, np.zeros(len(rows))]),
        np.concatenate([joint, of]),
        method,
    )
    count = len(y)
    fit = Fit(both.values, both.weight[:count], both.residual[:count], both.scaled)
    return fit, rows * size * both.weight[count:, None]


def weighted(columns: Array, y: Array, weight: Array) -> Fit:
    """Least squares of weight * (y - columns beta) by a QR decomposition of the scaled columns."""
    values, triangle = _solved(triangle_of(np.column_stack([columns, y]) * weight[:, None]))
    return Fit(values, weight, y - columns @ values, triangle)


@dataclass(frozen=True)
class Triangles:
    """The rows of [columns y], each joint's reduced to a triangle: all that least squares has to know of them.

    joint (k,) from 0, rows (k,) how many its triangle stands for, parts k times (<= p + 1, p + 1).
    """

    joint: Joints
    rows: NDArray[np.intp]
    parts: list[Array]

    @property
    def columns(self) -> Array:
        """(r, p) rows with the same inner products as all the columns."""
        return np.concatenate(self.parts)[:, :-1]


def joint_triangles(columns: Array, y: Array, joint: Joints) -> Triangles:
    """Of columns (rows, p) and y (rows,).

    A joint's torque knows nothing of the links before it: columns without an entry take no time.
    """
    count = np.bincount(joint)
    present = np.flatnonzero(count)
    parts = []
    for j in present:
        index = np.flatnonzero(joint == j)
        # the rows of a joint in one run are contiguous, and a slice needs no copy
        rows = slice(index[0], index[-1] + 1) if index[-1] - index[0] < len(index) else index
        of_joint = columns[rows]
        shown = np.flatnonzero(of_joint.any(axis=0))
        both = np.empty((len(of_joint), len(shown) + 1), order="F")  # as LAPACK needs it
        both[:, :-1], both[:, -1] = of_joint[:, shown], y[rows]
        if len(both) > len(shown):
            both = triangle_of(both, overwrite=True)
        part = np.zeros((len(both), columns.shape[1] + 1))
        part[:, shown], part[:, -1] = both[:, :-1], both[:, -1]
        parts.append(part)
    return Triangles(present, count[present], parts)


def weighted_by_joint(columns: Array, y: Array, joint: Joints, triangles: Triangles) -> Fit:
    """Least squares in which each joint's rows are divided by their noise, as an ordinary least-squares fit shows it.

    Both fits use the ``triangles`` of columns and y.
    """
    values, _ = _solved(triangle_of(np.concatenate(triangles.parts)))
    trial = np.append(values, -1.0)
    residual = np.array([np.linalg.norm(part @ trial) for part in triangles.parts])
    noise = np.ones(int(triangles.joint.max(initial=-1)) + 1)
    noise[triangles.joint] = residual / np.sqrt(triangles.rows)
    noise = _floored(noise)
    parts = [part / noise[j] for part, j in zip(triangles.parts, triangles.joint)]
    values, triangle = _solved(triangle_of(np.concatenate(parts)))
    return Fit(values, 1.0 / noise[joint], y - columns @ values, triangle)


def _solved(triangle: Array) -> tuple[Array, Array]:
    """values (b,) from the triangle of [columns y], and the triangle of the columns, each scaled to unit norm.

    Of least norm in the scaled columns, where rows do not determine a direction.
    """
    count = triangle.shape[1] - 1
    r, right = triangle[:count, :count], triangle[:count, count]
    scale = np.linalg.norm(r, axis=0)
    scale[scale == 0] = 1.0
    r = r / scale
    diagonal = np.abs(np.diag(r))
    if len(r) < count or diagonal.min(initial=1.0) < 1e-13:
        return np.linalg.lstsq(r, right, rcond=1e-13)[0] / scale, r
    return lapack.dtrtrs(r, right)[0] / scale, r


def joint_noise(residual: Array, joint: Joints, *, robust: bool = False, joints: int = 0) -> Array:
    """(J,) standard deviation of each joint's residual; ``robust``: from the median of its magnitude.

    J is at least ``joints``; a joint without rows gets 1.
    """
    noise = np.ones(max(joints, int(joint.max(initial=-1)) + 1))
    for j in np.unique(joint):
        rows = residual[joint == j]
        noise[j] = MAD_TO_STD * np.median(np.abs(rows)) if robust else np.sqrt(np.mean(rows**2))
    return _floored(noise)


def _floored(noise: Array) -> Array:
    return np.asarray(np.maximum(noise, 1e-12 * max(1.0, noise.max(initial=0.0))))


def relative_error(y: Array, residual: Array) -> float:
    """norm(residual) / norm(y): the contract's measure, over rows as they are (no weights)."""
    return float(np.linalg.norm(residual) / np.linalg.norm(y)) if len(y) else float("nan")
