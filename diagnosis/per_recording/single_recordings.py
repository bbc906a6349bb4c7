"""What one recording alone says: its residual, the columns of causes in it, and their coefficients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.measurements.currents.estimates import slow_variance_of
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.unseen_friction import as_shown, unseen_by_joint
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.run import Run, with_free
from diagnosis.selection.contradiction import SAME, SingleEstimate
from diagnosis.selection.design import Pair
from diagnosis.selection.regression import INDEPENDENT
from identification.selection import scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance


def runs_of(state: State) -> list[Run]:
    """Every recording without its own values of causes, the fitted ones first."""
    return [with_own(with_free(run, None), ()) for run in state.all_runs]


def whitened_of(run: Run) -> Array:
    """(n * rows,) whitened residual, joint after joint."""
    return np.asarray(run.whitened.T.ravel())


def columns_of_recordings(pairs: Sequence[Pair], state: State) -> list[Array]:
    """(n * rows, k) columns of each recording, the fitted ones first."""
    parts = []
    for part, columns in zip(state.model.data, zip(*pairs)):
        every = np.hstack([own.dense(len(part.y)) for own in columns])
        by_joint = every.reshape(-1, part.rows, every.shape[1])
        parts += [rows.reshape(-1, every.shape[1]) for rows in part.split(by_joint, axis=1)]
    return parts


def residuals_of(state: State) -> list[Array]:
    """(n * rows,) of each recording: its residual as the chosen are fitted to it."""
    return [rows.T.ravel() for part in state.data for rows in part.by_recording(part.y)]


def estimated_alone(run: Run, x: Array, y: Array, unknown: Array) -> SingleEstimate:
    """Coefficients by one recording; ``unknown`` (k,): std of those that it says nothing of.

    Where a joint stands, what friction does is one unknown for as long as it stands: its rows are no evidence each.
    Where it creeps, how friction turns round is one unknown of the joint (``unseen_friction``).
    """
    moves = comparable_rows(run)
    rows = moves.T.ravel()
    x, y = np.where(rows[:, None], x, 0.0), np.where(rows, y, 0.0)
    values = scaled_lstsq(x, y, INDEPENDENT)
    residual = y - x @ values
    covariance = cluster_covariance(
        x,
        [residual],
        np.tile(run.block, run.q.shape[1]),
        independent=INDEPENDENT,
        unknown=unknown,
        variance=slow_variance_of([residual.reshape(moves.T.shape).T], [run], [moves]),
    )
    at_rest = scaled_lstsq(x, as_shown(unseen_by_joint([run]), residual), INDEPENDENT)
    return SingleEstimate(run.name, values, covariance + at_rest @ at_rest.T + np.diag((SAME * values) ** 2))


def predicted_gains(x: Array, y: Array, without: Array, block: NDArray[np.intp]) -> Array:
    """(blocks,) fall of the squared residual ``without`` in every second block by coefficients from the others."""
    gains = np.zeros(int(block.max()) + 1)
    for fold in (0, 1):
        in_fold = block % 2 == fold
        residual = y[in_fold] - x[in_fold] @ scaled_lstsq(x[~in_fold], y[~in_fold], INDEPENDENT)
        gains += np.bincount(block[in_fold], without[in_fold] ** 2 - residual**2, len(gains))
    return gains
