"""Datasets, and candidates as whitened columns over all rows that they affect."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from diagnosis.measurements.currents.columns import at_own_joint, columns, own_columns
from diagnosis.residual.free_values import with_free
from diagnosis.residual.run import Run, merged, residual_with
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset
from diagnosis.selection.regression import at_joint
from identification.selection import Split


def dataset_of(runs: Sequence[Run]) -> Dataset:
    """The residuals of some recordings, in the layout of ``Dataset``."""
    numbers, first = [], 0
    for run in runs:
        numbers.append(run.block + first)
        first += int(run.block[-1]) + 1
    block = np.concatenate(numbers)
    joints = runs[0].q.shape[1]
    y = np.concatenate([run.whitened for run in runs]).T.ravel()
    return Dataset(tuple(runs), tuple(_together(runs)), y, np.tile(block, joints), len(block))


def _together(runs: Sequence[Run]) -> Iterator[Run]:
    for _, alike in itertools.groupby(runs, key=lambda run: (id(run.arm), run.powered, id(run.own_directions))):
        yield merged(list(alike))


def dataset_with(side: Dataset, terms: Sequence[EffectTerm]) -> Array:
    """(n * rows,) whitened residuals of a side's recordings under their arm with more effects."""
    whitened = [run.whiten(residual_with(run, terms)) for run in side.runs]
    return np.concatenate(whitened).T.ravel()


def columns_of(candidate: Candidate, side: Dataset) -> Columns:
    """The candidate's columns over all recordings of a set, over the std of each row."""
    if at_own_joint(candidate, side.runs[0].arm) and _joints_apart(side):
        return columns_at_joint(candidate, side)
    x = np.concatenate([run.whiten(columns(candidate, run)) for run in side.together])  # (rows, n, k)
    flat = x.transpose(1, 0, 2).reshape(-1, x.shape[2])
    return Columns(flat, slice(0, len(flat)))


def columns_at_joint(candidate: Candidate, side: Dataset) -> Columns:
    """``columns_of`` at the rows of the candidate's own joint; at all rows for an effect of the whole arm."""
    joint = candidate.joint
    if joint is None or not _joints_apart(side):
        return at_joint(columns_of(candidate, side), joint, side)
    own = [run.whiten_at(own_columns(candidate, run), joint) for run in side.together]
    return Columns(np.concatenate(own), side.of(joint))


def _joints_apart(side: Dataset) -> bool:
    """Whether the whitened rows of a joint depend on no other joint."""
    return all(run.own_directions is None for run in side.runs)


SHARPEST, IMPOSSIBLE = 0.5, 2.0
"""Coefficients of ``free_columns``: 0.5 makes friction a step at rest, to first order; what is above 2 by more than
SURE standard deviations is no smoothing, but a hump of friction, or another effect."""
SURE = 5.0


def bounded(data: Split[Dataset], free: Sequence[Split[Columns]]) -> tuple[Split[Dataset], list[Split[Columns]]]:
    """Data and free columns without those that would have to be sharper than a step to explain the data.

    In their place, the step is taken out of the data.
    """
    kept = []
    for pair in free:
        x, y = pair.fit.x[:, 0], data.fit.y[pair.fit.where]
        size = float(x @ x)
        if size == 0.0 or (x @ y) / size - SURE / np.sqrt(size) < IMPOSSIBLE:
            kept.append(pair)
            continue
        fit, held_out = (
            replace(side, y=side.y - columns.spread(np.array([SHARPEST]), len(side.y)))
            for side, columns in zip(data, pair)
        )
        data = Split(fit, held_out, data.two_fold)
    return data, kept


def free_columns(side: Dataset, arm: Arm) -> list[Columns]:
    """Columns that are always in the model: an error of the Coulomb smoothing velocity (``sign_velocity``).

    No data sheet states it, and simulations differ in it. d/dw of v / sqrt(v^2 + w^2) = -v w / (v^2 +
    w^2)^(3/2), times F over the drive's constant.
    """
    width = arm.joint_array("sign_velocity")
    force = np.array([max(joint.rest_friction) / joint.drive_constant for joint in arm.joints])
    slopes = [with_free(run, None).whiten(force * run.v * width**2 / np.hypot(run.v, width) ** 3) for run in side.runs]
    x = np.concatenate(slopes)
    return [Columns(x[:, [j]], side.of(j + 1)) for j in np.flatnonzero(force > 0.0).tolist()]
