"""Least squares of the wrench on a floating base: thruster gains, added mass, drag and buoyancy with deviations.

Rows of a degree of freedom are weighted by the noise of that degree; the covariance takes blocks of time for
independent, not rows. What differentiated noise in the velocity does to the columns (it makes added masses too small)
is not in the deviations; ``BaseRun`` filters it to a few per mille.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from identification.floating_base.columns import Rows, whitened
from identification.selection.cluster_covariance import cluster_covariance
from identification.selection.least_squares import scaled_lstsq

INDEPENDENT = 1e-4
"""Singular value of the scaled columns below which a direction counts as not excited."""
MOST_STEPS = 8
"""Steps of a fit with dead zones, at most."""
CONVERGED = 1e-4
"""Step (N and the like) after which a fit ends."""


def fitted(rows: Rows, start: Array, free: Sequence[int], scale: Array) -> Array:
    """(p,) ``start`` with the parameters ``free`` (column numbers) fitted; unexcited directions stay at the start.

    Dead zones need several Gauss-Newton steps, all other parameters one.
    """
    values, free = start.copy(), list(free)
    zones = [k for k in free if rows.names[k].endswith(".dead_zone")]
    for _ in range(MOST_STEPS if zones else 1):
        columns, residual = whitened(rows, values, scale, free)
        step = scaled_lstsq(columns, residual, INDEPENDENT)
        values[free] += step
        for k in zones:
            values[k] = np.clip(values[k], 0.0, rows.largest(rows.names[k]))
        if np.abs(step).max(initial=0.0) < CONVERGED:
            break
    return values


def noise_scale(rows: Rows, values: Array) -> Array:
    """(6,) N and N m: rms residual of each degree, never less than a thousandth of its wrench."""
    residual = np.sqrt(np.mean(rows.residual(values) ** 2, axis=0))
    return np.maximum(residual, 1e-3 * np.sqrt(np.mean(rows.known**2, axis=0)) + 1e-9)


def covariance(rows: Rows, values: Array, free: Sequence[int], scale: Array) -> Array:
    """(f, f) of the parameters ``free``."""
    columns, residual = whitened(rows, values, scale, free)
    return cluster_covariance(columns, [residual], np.repeat(rows.block, rows.known.shape[1]), independent=INDEPENDENT)


def excited(rows: Rows, free: Sequence[int], scale: Array) -> Array:
    """(f,) whether the data determine each parameter near the model's values, the others free as well."""
    x = (rows.columns / scale[:, None]).reshape(-1, rows.columns.shape[-1])[:, list(free)]
    size = np.linalg.norm(x, axis=0)
    there = size > 1e-9 * max(size.max(initial=0.0), 1e-300)
    values, vectors = np.linalg.eigh((x / np.where(there, size, 1.0)).T @ (x / np.where(there, size, 1.0)))
    unseen = vectors[:, values < INDEPENDENT**2 * max(values[-1], 1e-300)]
    return np.asarray(there & ((unseen**2).sum(axis=1) < 0.01))
