"""Encoder zeros that hold for one run only (``preset = "start"``).

They are estimated for fitted runs, and bounded for predicted ones.

A counter that is set at each start is up to one count off, differently in every run: at joint 2 of the Puma one count
is 0.07 mm at the target, as much as the noise of the tracker. Each fitted run gets zeros of its own, with one count as
prior standard deviation. The zeros of a run that is to be predicted are unknown; ``expected`` is the error that they
cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.runs import Run, points_of, velocity_of
from identification.kinematics.estimation.extensions import Extension, deflections, prior_scales
from identification.kinematics.estimation.map_estimation import Fit, fit
from identification.kinematics.models.chain import Chain, Index, position_jacobian
from identification.kinematics.models.parameters import Parameters


def with_own_zeros(
    parameters: Parameters,
    runs: Sequence[Run],
    rows: Sequence[Index],
    estimate: Fit,
    chosen: Sequence[Extension],
    gravity: Gravity | None,
) -> tuple[Points, Fit, Array]:
    """The fit with a zero of its own for every counted encoder of every run, and those zeros (zeros,) rad."""
    columns, counts = zero_columns(runs, rows)
    points = points_of(runs, rows)
    bend = deflections(chosen, points.q, velocity=velocity_of(runs, rows), gravity=gravity)
    both = points.deflected(np.concatenate((bend, columns), axis=2))
    scale = np.concatenate((prior_scales(chosen), counts))
    bends, extensions = bend.shape[2], len(estimate.extension)
    start = np.concatenate((estimate.extension, np.zeros(len(counts))))
    fitted = fit(parameters, both, start=estimate.values, extension_scale=scale, extension_start=start)
    zeros = fitted.extension[bends:]
    kept = len(parameters.free) + extensions
    marginal = replace(fitted, extension=fitted.extension[:extensions], covariance=fitted.covariance[:kept, :kept])
    moved = replace(points, q=points.q + columns @ zeros, deflections=bend if chosen else None)
    return moved, marginal, zeros


def zero_columns(runs: Sequence[Run], rows: Sequence[Index]) -> tuple[Array, Array]:
    """Deflections (N, joints, zeros) of the chosen rows of all runs, and prior deviations (zeros,) rad.

    There is one zero per run and joint; runs whose count is not known have none.
    """
    owners = [(k, j) for k, run in enumerate(runs) if run.count is not None for j in np.flatnonzero(run.count)]
    which = np.concatenate([np.full(len(r), k) for k, r in enumerate(rows)])
    columns = np.zeros((len(which), runs[0].q.shape[1], len(owners)))
    for index, (k, j) in enumerate(owners):
        columns[which == k, j, index] = 1.0
    return columns, np.array([_count(runs[k])[j] for k, j in owners])


def with_zeros(runs: Sequence[Run], zeros: Array) -> list[Run]:
    """The runs with their angles corrected by the zeros (zeros,) rad, in the order of ``zero_columns``."""
    corrected, remaining = [], list(zeros)
    for run in runs:
        off = np.zeros(run.q.shape[1])
        if run.count is not None:
            for j in np.flatnonzero(run.count):
                off[j] = remaining.pop(0)
        corrected.append(replace(run, q=run.q + off))
    return corrected


def expected(chain: Chain, runs: Sequence[Run]) -> float:
    """m rms a coordinate: error of predicted points from the zeros of runs alone.

    The count that a counter is set to, and the place within it where the motor stands, are each off by step / sqrt(12).
    """
    squares, points = 0.0, 0
    for run in runs:
        rows = np.flatnonzero(run.usable)
        rows = rows[:: max(1, len(rows) // 2000)]
        if run.count is not None and len(rows):
            joint = position_jacobian(chain, run.q[rows], np.full(len(rows), run.target))[1][:, :, chain.joint_steps()]
            squares += len(rows) * float(np.mean(np.sum((joint * run.count) ** 2, axis=2))) / 6.0
        points += len(rows)
    return float(np.sqrt(squares / points)) if points else 0.0


def _count(run: Run) -> Array:
    assert run.count is not None
    return run.count
