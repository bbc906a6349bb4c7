"""Recordings whose rows have stamps of their own, put onto a uniform grid.

The filters and differences of a residual take rows as equally spaced. Where stamps jitter by a tenth of a period, that
would be an error of every acceleration, which a compliance of the drive explains well. Stamps that jitter by less may
be those of rows that do, or their clock may be the worse one: the angles, of a motion that is smooth, show which.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from arm_io.types import Array
from daq.recording import Recording
from diagnosis.residual.filters import Samples
from diagnosis.residual.noise.channels import KnownNoise, scatter
from diagnosis.residual.noise.encoder_step import encoder_step
from identification.preprocessing.grid import on_grid

EVEN, UNEVEN = 1e-4, 0.02
"""Of a period, rms: stamps this close to equal spacing are taken for it, and none from here on.

The largest error of a stamp grows with the length of a recording and is no measure of the others.
"""
SMOOTHER = 0.95
"""Scatter of the angles of a joint at equally spaced instants, over that of its rows, below which the stamps in between
are right. Splines leave 0.998 of it or more of rows that were even."""
TORN = 2.5
"""Periods between two rows that are no mere jitter: rows are missing, and a grid would invent them."""
SPLINED = ("q", "i", "ql")
"""Signals that are interpolated by splines; other signals by straight lines, integers by the nearest row."""


def grid_of(t: Array, q: Array) -> Array | None:
    """As many instants as the stamps t (n,) s, equally spaced; None where rows are, or where some are missing.

    q: (n, J) rad, the angles of the rows.
    """
    if len(t) < 3:
        return None
    grid, steps = np.linspace(t[0], t[-1], len(t)), np.diff(t)
    # about their own line: the first and the last stamp, between which the grid lies, jitter as the others do
    off = float(np.std(signal.detrend(t - grid))) / (grid[1] - grid[0])
    if steps.max() > TORN * np.median(steps) or off < EVEN:
        return None
    return grid if off >= UNEVEN or _smoother(t, q, grid) else None


def _smoother(t: Array, q: Array, grid: Array) -> bool:
    """Whether angles q (n, J) rad at t (n,) s are smoother at the instants of a grid than if their rows were even."""
    of_rows, on_instants = scatter(q), scatter(on_grid(t, q, grid, grid[1] - grid[0])[0])
    return bool(np.any(on_instants < SMOOTHER * of_rows))


def even_samples(samples: Samples) -> Samples:
    """t (n,) s, q and i (n, J) with equally spaced rows; the same object where they are, or cannot be."""
    t, q, i = samples
    grid = grid_of(t, q)
    if grid is None:
        return samples
    dt = float(grid[1] - grid[0])
    return grid, on_grid(t, q, grid, dt)[0], on_grid(t, i, grid, dt)[0]


def known_noise(t: Array, q: Array, known: KnownNoise) -> KnownNoise:
    """``known``, with the steps of the angles q (n, J) as recorded at t (n,) s, if they are put onto an even grid.

    On the grid the steps are no longer visible. An encoder whose angles have no common step gets 0.
    """
    grid, demands = grid_of(t, q), known.demands
    if grid is None:
        return known
    if demands is not None:
        demands = np.stack([np.interp(grid, t, column) for column in demands.T], axis=1)
    return replace(known, steps=np.array([encoder_step(column) for column in q.T]), demands=demands)


def even(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings with equally spaced rows; the same objects where they are, or cannot be."""
    return [r if (grid := grid_of(r.t, r.q)) is None else _even(r, grid) for r in recordings]


def _even(recording: Recording, grid: Array) -> Recording:
    t = recording.t
    later = np.searchsorted(t, grid).clip(1, len(t) - 1)
    nearest = np.where(grid - t[later - 1] < t[later] - grid, later - 1, later)
    curves = {name: partial(_spline, t, grid) for name in SPLINED}
    return resampled(recording, grid, nearest, curves)


def _spline(t: Array, grid: Array, values: Array) -> Array:
    return on_grid(t, values, grid, grid[1] - grid[0])[0]


def resampled(
    recording: Recording, stamps: Array, rows: NDArray[np.intp], curves: Mapping[str, Callable[[Array], Array]]
) -> Recording:
    """A recording with rows at other stamps (m,) s.

    Signals by their ``curves``, of values (n, J) to (m, J); other numbers by straight lines; what is no number, and
    integers, as in ``rows`` (m,) of the recording.
    """
    t = recording.t
    changed: dict[str, Any] = {"t": stamps}
    for field in fields(recording):
        values = getattr(recording, field.name)
        if field.name == "t" or not isinstance(values, np.ndarray) or len(values) != len(t):
            continue
        if field.name in curves:
            changed[field.name] = curves[field.name](values)
        elif np.issubdtype(values.dtype, np.floating):
            straight = [np.interp(stamps, t, column) for column in values.reshape(len(t), -1).T]
            changed[field.name] = np.stack(straight, axis=1).reshape(len(stamps), *values.shape[1:])
        else:
            changed[field.name] = values[rows]
    return replace(recording, **changed)
