"""Parameters of the causes of the currents, with standard deviations that allow for coloured residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arm_io.types import Array
from diagnosis.cause import Estimate
from diagnosis.measurements.currents.design_matrix import columns_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.unseen_friction import as_shown, unseen_by_joint
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import RELATIVE_STEP, Candidate
from diagnosis.selection.design import Columns, Dataset
from diagnosis.selection.estimates import estimates
from identification.selection import scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance, slow_variance

CORRELATED = 0.5
"""s over which a residual may be correlated: half of a block."""


def estimates_of(state: State) -> list[list[Estimate]]:
    """Parameters of every chosen candidate."""
    if not state.chosen:
        return []
    joints, (covariance, places) = state.model.arm.joints, covariance_of(state)
    return [
        estimates(
            candidate,
            c.tolist(),
            covariance[place, place],
            joints[candidate.joint - 1] if candidate.joint else None,
        )
        for candidate, c, place in zip(state.chosen, state.coefficients, places)
    ]


def together(state: State, index: int) -> float:
    """Significance of a chosen candidate's coefficients together, in std of one equally unlikely coefficient.

    A pendulum shows the sum of a body's mass times the length of its link and of its moment, and neither alone.
    """
    covariance, places = covariance_of(state)
    c = np.asarray(state.coefficients[index], float)
    first = places[index].start
    own = covariance[first : first + len(c), first : first + len(c)]
    scale = np.sqrt(np.diag(own))
    whitened = np.linalg.lstsq(own / np.outer(scale, scale), c / scale, rcond=1e-12)[0]
    return float(stats.norm.isf(stats.chi2.sf(float(whitened @ (c / scale)), np.count_nonzero(c)) / 2))


def covariance_of(state: State) -> tuple[Array, list[slice]]:
    """Covariance of all coefficients and searched parameters of the chosen candidates, and the rows of each.

    It is clustered by block, with one more column for every nonlinear parameter (derivative of its
    columns). In addition to the residual, the share ``Limits.systematic`` of what is explained is uncertain,
    independently in every block; so are the parameters of a model that says so, how friction turns round near rest (one
    unknown per joint, as large as the residual shows), and what may fold, however small; and the residual of every
    joint, as if it were alike in all blocks, correlated as it is: a column that acts in few of them follows what is
    there.
    """
    model, fit = state.model, state.data.fit
    x, unknown, places = list[Array](), list[Array](), list[slice]()
    explained = np.zeros(len(fit.y))
    for candidate, c in zip(state.chosen, state.coefficients):
        columns = model.columns(candidate).fit
        slopes, values = _slopes(candidate, columns, c, state)
        first = sum(block.shape[1] for block in x)
        x.append(np.column_stack([columns.dense(len(fit.y)), *slopes]))
        places.append(slice(first, first + x[-1].shape[1]))
        unknown.append(np.array([*(candidate.largest(k) for k in range(len(c))), *values]))
        explained += columns.contribution(c, len(fit.y))
    x += [pair.fit.dense(len(fit.y)) for pair in model.free]
    design = np.hstack(x)
    covariance = cluster_covariance(
        design,
        (state.residual.fit, LIMITS.systematic * explained),
        fit.block,
        independent=LIMITS.independent,
        unknown=np.concatenate([*unknown, np.zeros(len(model.free))]),
        variance=slow_variance_of(fit.by_recording(state.residual.fit), fit.runs),
    )
    directions = [as_shown(unseen_by_joint(fit.runs), state.residual.fit)]
    if model.uncertain is not None:
        directions.append(model.uncertain.stated)
    if (folded := _folded(fit)).size:
        directions.append(folded)
    for direction in directions:
        # error of the coefficients due to friction near rest, to errors of the model's parameters, or to what may fold
        moved = scaled_lstsq(design, direction, LIMITS.independent)
        covariance = covariance + moved @ moved.T
    return covariance, places


def slow_variance_of(
    residuals: Sequence[Array], runs: Sequence[Run], rows: Sequence[NDArray[np.bool_]] | None = None
) -> Array:
    """(N,) variance of every row of whitened residuals (m, n) of recordings, times the rows that count as one.

    Near standstill the std of a row is that of friction, and its whitened residual is next to nothing. rows (m, n)
    each: those that are judged, while the residual of the others is 0; None: all.
    """
    alike = max(run.alike for run in runs)
    longest = round(CORRELATED * min(run.per_second for run in runs))
    shares = [run.instruments / run.deviation for run in runs]
    if rows is not None:
        shares = [share * judged for share, judged in zip(shares, rows)]
    return np.concatenate(
        [
            slow_variance([one[:, j] for one in residuals], [share[:, j] for share in shares], longest, alike)
            for j in range(len(runs[0].arm))
        ]
    )


def _folded(fit: Dataset) -> Array:
    """(N, k): one std of what sampling may have put into each joint unseen, alike in all recordings: clocks stay."""
    may = np.any([run.may_fold.any(axis=0) for run in fit.runs], axis=0)
    joints = (1 + np.flatnonzero(may)).tolist()
    columns = np.zeros((len(fit.y), len(joints)))
    for k, joint in enumerate(joints):
        columns[fit.of(joint), k : k + 1] = fit.whitened(fit.at_joint("may_fold", joint)[:, None], joint)
    return columns


def _slopes(candidate: Candidate, columns: Columns, c: Array, state: State) -> tuple[list[Array], list[float]]:
    """(N,) derivatives of a candidate's contribution by each of its nonlinear parameters, and their values."""
    fit, slopes, values = state.data.fit, [], []
    for name in candidate.searched():
        value = dict(candidate.shape)[name]
        moved = columns_of(candidate.at(name, (1.0 + RELATIVE_STEP) * value), fit)
        change = moved.contribution(c, len(fit.y)) - columns.contribution(c, len(fit.y))
        slopes.append(change / (RELATIVE_STEP * value))
        values.append(value)
    return slopes, values
