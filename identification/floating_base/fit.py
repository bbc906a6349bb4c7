"""Least squares of the wrench on a floating base: thruster gains, added mass, drag and buoyancy with deviations.

Rows of a degree of freedom are weighted by the noise of that degree; the covariance takes blocks of time for
independent, not rows. What differentiated noise in the velocity does to the columns (it makes added masses too small)
is not in the deviations; ``BaseRun`` filters it to a few per mille.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.moving_base import OF_ARM, floating, nominal_wrench_parameters
from arm_model.tables import unit_of, with_base_parameters
from daq.recording import Recording
from identification.base_result import BaseIdentification, BaseValue
from identification.floating_base.columns import Rows, whitened
from identification.floating_base.held_out import sides
from identification.floating_base.rows import BLOCK_SECONDS
from identification.floating_base.wrenches import wrenches_of
from identification.selection.cluster_covariance import cluster_covariance
from identification.selection.least_squares import scaled_lstsq

INDEPENDENT = 1e-4
"""Singular value of the scaled columns below which a direction counts as not excited."""
MOST_STEPS, SETTLED = 8, 1e-4
"""Steps of a fit with dead zones, and the step (N and the like) after which it ends."""
RELATIVE = 0.3
"""Largest relative deviation of an identifiable parameter."""


def fitted(rows: Rows, start: Array, free: Sequence[int], scale: Array) -> Array:
    """(p,) ``start`` with the parameters ``free`` (numbers of columns) fitted; unexcited directions stay there.

    Dead zones enter by Gauss and Newton, everything else at once.
    """
    values, free = start.copy(), list(free)
    zones = [k for k in free if rows.names[k].endswith(".dead_zone")]
    for _ in range(MOST_STEPS if zones else 1):
        columns, residual = whitened(rows, values, scale, free)
        step = scaled_lstsq(columns, residual, INDEPENDENT)
        values[free] += step
        for k in zones:
            values[k] = np.clip(values[k], 0.0, rows.largest(rows.names[k]))
        if np.abs(step).max(initial=0.0) < SETTLED:
            break
    return values


def noise_scale(rows: Rows, values: Array) -> Array:
    """(6,) N and N m: rms residual of each degree, never less than a thousandth of its wrench."""
    residual = np.sqrt(np.mean(rows.residual(values) ** 2, axis=0))
    return np.maximum(residual, 1e-3 * np.sqrt(np.mean(rows.known**2, axis=0)) + 1e-9)


def covariance(rows: Rows, values: Array, free: Sequence[int], scale: Array) -> Array:
    """(f, f) of the parameters ``free``."""
    columns, residual = whitened(rows, values, scale, free)
    return cluster_covariance(columns, [residual], np.repeat(rows.block, 6), independent=INDEPENDENT)


def excited(rows: Rows, free: Sequence[int], scale: Array) -> Array:
    """(f,) whether the data determine each parameter near the model's values, the others free as well."""
    x = (rows.columns / scale[:, None]).reshape(-1, rows.columns.shape[-1])[:, list(free)]
    size = np.linalg.norm(x, axis=0)
    there = size > 1e-9 * max(size.max(initial=0.0), 1e-300)
    values, vectors = np.linalg.eigh((x / np.where(there, size, 1.0)).T @ (x / np.where(there, size, 1.0)))
    unseen = vectors[:, values < INDEPENDENT**2 * max(values[-1], 1e-300)]
    return np.asarray(there & ((unseen**2).sum(axis=1) < 0.01))


def identify_base(
    fit: Sequence[Recording], arm: Arm, *, held_out: Sequence[Recording] = (), progress: Progress = lambda _: None
) -> BaseIdentification:
    """Identifies the floating base of ``arm``; InputError where a recording cannot be used."""
    base = floating(arm)
    progress("reading the motion of the base")
    rows = sides(arm, fit, held_out)
    names = rows.fit.names
    start = np.array([nominal_wrench_parameters(arm)[name] for name in names])
    free = [k for k, name in enumerate(names) if name not in OF_ARM]
    if len(np.unique(rows.fit.block)) < 2 or len(np.unique(rows.held_out.block)) < 2:
        raise InputError(fit[0].path, f"is too short; at least four blocks of {BLOCK_SECONDS:g} s are needed")
    progress("least squares")
    scale = noise_scale(rows.fit, fitted(rows.fit, start, free, np.ones(6)))
    values = fitted(rows.fit, start, free, scale)
    scale = noise_scale(rows.fit, values)
    values = fitted(rows.fit, start, free, scale)
    spread = np.sqrt(np.diag(covariance(rows.fit, values, free, scale)))
    seen = excited(rows.fit, free, scale)
    found = [
        BaseValue(
            name=names[k],
            value=float(values[k]),
            std=float(std) if known else None,
            nominal=float(start[k]),
            unit=unit_of(names[k]),
            identifiable=bool(known and std < RELATIVE * abs(values[k])),
        )
        for k, std, known in zip(free, spread, seen)
    ]
    better = with_base_parameters(base, {value.name: value.value for value in found if value.std is not None})
    return BaseIdentification(
        arm=replace(arm, floating=better),
        model=arm,
        fit=[str(recording.path) for recording in fit],
        held_out="split" if rows.split else [str(recording.path) for recording in held_out],
        parameters=found,
        thrust_rms=_rms(rows.held_out.thrust_wrench(values)),
        before_rms=_rms(rows.held_out.residual(start)),
        after_rms=_rms(rows.held_out.residual(values)),
        fit_rms=_rms(rows.fit.residual(values)),
        runs=wrenches_of(rows, start, values, scale),
    )


def _rms(values: Array) -> Array:
    """(6,) of values (k, 6)."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
