"""Least squares of the wrench on a floating base: thruster gains, added mass, drag and buoyancy with deviations.

Rows of a degree of freedom are weighted by the noise of that degree; the covariance takes blocks of time for
independent, not rows. What differentiated noise in the velocity does to the columns (it makes added masses too small)
is not in the deviations; ``BaseRun`` filters it to a few per mille.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.effects import described
from arm_model.geometry import relinked
from arm_model.moving_base import OF_ARM, REACTION, floating, nominal_wrench_parameters
from arm_model.tables import unit_of, with_base_parameters
from daq.recording import Recording
from identification.floating_base.columns import Rows, rows_of, whitened
from identification.floating_base.result import BaseIdentification, BaseValue
from identification.floating_base.rows import BLOCK_SECONDS, base_run
from identification.selection.cluster_covariance import cluster_covariance
from identification.selection.least_squares import scaled_lstsq

INDEPENDENT = 1e-4
"""Singular value of the scaled columns below which a direction counts as not excited."""
HELD_OUT = 0.3
"""Share at the end of each recording that judges a fit where no recording is held out."""
RELATIVE = 0.3
"""Largest relative deviation of an identifiable parameter."""


@dataclass(frozen=True)
class Sides:
    """Rows to fit and rows to judge by; ``split``: both are parts of the same recordings."""

    fit: Rows
    held_out: Rows
    split: bool


def sides(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Sides:
    """Rows of recordings; InputError where one cannot be used.

    Effects of the arm that are other numbers in its description act; others, such as friction, do not reach the base.
    """
    arm = described(relinked(arm))
    rows = rows_of(arm, [base_run(recording, arm) for recording in fit])
    if held_out:
        return Sides(rows, rows_of(arm, [base_run(recording, arm) for recording in held_out]), False)
    last = np.zeros(len(rows.t), bool)
    for number in np.unique(rows.run):
        mine = np.flatnonzero(rows.run == number)
        last[mine[int((1 - HELD_OUT) * len(mine)) :]] = True
    return Sides(part(rows, ~last), part(rows, last), True)


def part(rows: Rows, taken: Array) -> Rows:
    """Some of the rows (mask (k,)), with their blocks numbered anew."""
    block = np.unique(rows.block[taken], return_inverse=True)[1]
    return Rows(rows.names, rows.columns[taken], rows.known[taken], block, rows.t[taken], rows.run[taken])


def fitted(rows: Rows, start: Array, free: Sequence[int], scale: Array) -> Array:
    """(p,) ``start`` with the parameters ``free`` (numbers of columns) fitted; unexcited directions stay there."""
    columns, known = whitened(rows, scale)
    values = start.copy()
    values[list(free)] += scaled_lstsq(columns[:, list(free)], known - columns @ start, INDEPENDENT)
    return values


def noise_scale(rows: Rows, values: Array) -> Array:
    """(6,) N and N m: rms residual of each degree, never less than a thousandth of its wrench."""
    residual = np.sqrt(np.mean(rows.residual(values) ** 2, axis=0))
    return np.maximum(residual, 1e-3 * np.sqrt(np.mean(rows.known**2, axis=0)) + 1e-9)


def covariance(rows: Rows, values: Array, free: Sequence[int], scale: Array) -> Array:
    """(f, f) of the parameters ``free``."""
    columns, known = whitened(rows, scale)
    residual = known - columns @ values
    return cluster_covariance(columns[:, list(free)], [residual], np.repeat(rows.block, 6), independent=INDEPENDENT)


def excited(rows: Rows, free: Sequence[int], scale: Array) -> Array:
    """(f,) whether the data determine each parameter, the others free as well."""
    columns, _ = whitened(rows, scale)
    x = columns[:, list(free)]
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
        fit=[str(recording.path) for recording in fit],
        held_out="split" if rows.split else [str(recording.path) for recording in held_out],
        parameters=found,
        measured_rms=_rms(rows.held_out.known - _reaction(rows.held_out)),
        before_rms=_rms(rows.held_out.residual(start)),
        after_rms=_rms(rows.held_out.residual(values)),
        fit_rms=_rms(rows.fit.residual(values)),
    )


def _reaction(rows: Rows) -> Array:
    return rows.columns[:, :, rows.names.index(REACTION)]


def _rms(values: Array) -> Array:
    """(6,) of values (k, 6)."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
