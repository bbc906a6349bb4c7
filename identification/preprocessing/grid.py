"""Samples with stamps of their own put onto a uniform grid, and how far each instant of the grid is from a sample.

Column by column, and holes only where there are any: a recording of an hour is a hundred times longer than the arrays
kept in addition.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator, make_interp_spline

from arm_io.types import Array

Mask = NDArray[np.bool_]

JITTER = 0.01
"""Share of the period within which stamps count as evenly spaced."""
CUBIC = 4
"""Samples that a cubic spline needs."""
HOLE = 2.5
"""Periods between two samples from which there is a hole, not only jitter."""


def uniform_grid(t: Array) -> tuple[Array, float]:
    """Instants (m,) s from the first of t (n,) s on, and the period between them, the median one."""
    dt = float(np.median(np.diff(t)))
    return t[0] + dt * np.arange(int(np.floor((t[-1] - t[0]) / dt + JITTER)) + 1), dt


def on_grid(t: Array, samples: Array, grid: Array, dt: float) -> tuple[Array, NDArray[np.float32]]:
    """Samples (n, J), NaN where missing, at the grid's instants (m, J), and their distance to real samples.

    Distances (m, J) s are to the nearest real sample, in holes only. A column with fewer samples than a cubic needs, as
    of a joint without a link encoder, stays NaN, and is infinitely far.
    """
    on = len(grid) == len(t) and float(np.max(np.abs(t - grid))) < JITTER * dt
    values, distance = np.empty((len(grid), samples.shape[1])), np.zeros((len(grid), samples.shape[1]), np.float32)
    for j, column in enumerate(samples.T):
        there = np.isfinite(column)
        if on and there.all():
            values[:, j] = column
            continue
        if there.sum() < CUBIC:
            values[:, j], distance[:, j] = np.nan, np.inf
            continue
        known, column = (t, column) if there.all() else (t[there], column[there])
        values[:, j] = make_interp_spline(known, column, k=3)(np.clip(grid, known[0], known[-1]))
        after = np.searchsorted(known, grid).clip(1, len(known) - 1)
        hole = known[after] - known[after - 1]
        distance[:, j] = hole / 2
        distance[(grid < known[0]) | (grid > known[-1]), j] = np.inf
        # A hole is crossed without overshoot. Elsewhere that would cut the tops off servo ripple, always on the same
        # side, by 0.5 % of an inertia.
        across = np.flatnonzero(hole > HOLE * dt)
        if len(across):
            inside = np.clip(grid[across], known[0], known[-1])
            values[across, j] = PchipInterpolator(known, column)(inside)
    return values, distance


def longest_whole(far: NDArray[np.float32], dt: float) -> slice:
    """The longest stretch of the grid without holes of more than ten rows in any joint."""
    torn = np.concatenate([[True], np.any(far > 5.5 * dt, axis=1), [True]])
    edges = np.flatnonzero(torn)
    longest = int(np.argmax(np.diff(edges)))
    return slice(int(edges[longest]), int(edges[longest + 1]) - 1)


def nearest(t: Array, marked: Mask, grid: Array) -> Mask:
    """(m, J): the grid's instants nearest to the ``marked`` (n, J) rows at t (n,) s."""
    out = np.zeros((len(grid), marked.shape[1]), bool)
    rows, joints = np.nonzero(marked)
    dt = grid[1] - grid[0] if len(grid) > 1 else 1.0
    out[np.clip(np.rint((t[rows] - grid[0]) / dt).astype(int), 0, len(grid) - 1), joints] = True
    return out
