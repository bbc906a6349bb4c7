"""From coefficients of columns to the parameters of an effect, with uncertainty that coloured residuals do not flatter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects.definition import SYSTEMATIC
from diagnosis.cause import Estimate
from diagnosis.measurements.currents.design_matrix import Columns, Side, columns_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import INDEPENDENT, Accepted, fit_gain
from diagnosis.units import unit_at
from identification.selection.cluster_covariance import cluster_covariance


def physical(candidate: Candidate, coefficients: Array) -> bool:
    """Whether the parameters have the signs that they must have (no negative mass, stiffness, gap or friction share) and sizes that can be."""
    if candidate.unit_amplitude and not 0.25 < coefficients[0] < 4.0:
        return False  # such an effect is there as it is or not at all; off the grid's points it is seen in part
    values = candidate.parameters(coefficients.tolist())
    return all(candidate.definition.admits(name, value) for name, value in values.items())


def sharpened(candidate: Candidate, accepted: Accepted, fit: Side, arm: Arm) -> Candidate:
    """The candidate with each continuous shape parameter at its best between the neighbours on its grid, one after the other."""
    searched = candidate.searched()
    for name in searched * (2 if len(searched) > 1 else 1):
        value = dict(candidate.shape)[name]

        def worse(log_value: float, name: str = name, now: Candidate = candidate) -> float:
            trial = now.at(name, float(np.exp(float(log_value))))
            gain, c = fit_gain(columns_of(trial, fit, arm), accepted)
            # by shape alone: what a coefficient of 1 gains, for a gain that is quadratic in the coefficient
            return -gain * (1.0 - (1.0 / c[0] - 1.0) ** 2) if now.unit_amplitude and c[0] else -gain

        reach = 1.5 if candidate.definition.spring is not None else 3.0  # their grids are finer
        found = optimize.minimize_scalar(
            worse,
            bounds=(np.log(value / reach), np.log(value * reach)),
            method="bounded",
            options={"xatol": 0.01, "maxiter": 14},
        )
        candidate = candidate.at(name, float(np.exp(found.x)))
    return candidate


def estimates(
    chosen: Sequence[Candidate], coefficients: Array, left: Array, free: Sequence[Columns], fit: Side, arm: Arm
) -> list[list[Estimate]]:
    """Parameters of every chosen candidate, coefficients (sum of k,) in their order, with standard deviations.

    left (N,): whitened residual with all of them fitted; free: columns that were fitted beside them.

    Covariance: the sandwich B (sum over blocks of g_b g_b^T) B with g_b = X_b^T e_b and B = (X^T X)^+, X with a column more for every continuous
    shape parameter (derivative of its columns): right for residuals correlated within a block (Liang & Zeger, Biometrika 73, 1986). Beside the
    residual e, the share ``SYSTEMATIC`` of what is explained is in doubt in every block for itself.
    """
    columns = [columns_of(candidate, fit, arm) for candidate in chosen]
    parts = np.split(coefficients, np.cumsum([c.x.shape[1] for c in columns])[:-1])
    wide, moves, sizes = (
        [],
        [],
        [],
    )  # whitened columns; for each, how parameters follow, and how large its coefficient may be
    for index, (candidate, column, part) in enumerate(zip(chosen, columns, parts)):
        for k in range(len(part)):
            wide.append(_spread(column, np.eye(len(part))[k], fit))
            moves.append((index, _by_coefficient(candidate, part, k)))
            sizes.append(candidate.largest(k))
        for name in candidate.searched():
            value = dict(candidate.shape)[name]
            step = 0.02 * value
            other = candidate.at(name, value + step)
            slope = _spread(columns_of(other, fit, arm), part, fit) - _spread(column, part, fit)
            wide.append(slope / step)
            moves.append((index, {name: 1.0}))
            sizes.append(value)
    sizes += [0.0] * len(free)
    explained = np.sum([_spread(column, part, fit) for column, part in zip(columns, parts)], axis=0)
    x = np.column_stack(wide + [_spread(c, np.ones(1), fit) for c in free])
    doubts = left, SYSTEMATIC * explained
    covariance = cluster_covariance(x, doubts, fit.block, independent=INDEPENDENT, unknown=np.array(sizes))
    result = []
    for index, (candidate, part) in enumerate(zip(chosen, parts)):
        values = candidate.parameters(part.tolist())
        own = arm.joints[candidate.joint - 1] if candidate.joint else None
        units = {p.name: unit_at(own, p.unit, p.name) if own else p.unit for p in candidate.definition.parameters}
        rows = []
        for name, value in values.items():
            if candidate.definition[name].fixed:
                continue
            slope = np.array([move.get(name, 0.0) if owner == index else 0.0 for owner, move in moves])
            of_moves = covariance[: len(moves), : len(moves)]
            std = float(np.sqrt(max(float(slope @ of_moves @ slope), 0.0)))
            systematic = 0.0 if candidate.definition[name].whole else candidate.definition.model_error * abs(value)
            rows.append(Estimate(name, value, float(np.hypot(std, systematic)), units[name]))
        result.append(rows)
    return result


def _spread(columns: Columns, coefficients: Array, side: Side) -> Array:
    return columns.spread(coefficients, len(side.y))


def _by_coefficient(candidate: Candidate, part: Array, k: int) -> dict[str, float]:
    """Derivative of every parameter by coefficient k, by central differences."""
    step = 1e-4 * max(float(np.max(np.abs(part))), 1e-9)
    up, down = part.copy(), part.copy()
    up[k] += step
    down[k] -= step
    after, before = candidate.parameters(up.tolist()), candidate.parameters(down.tolist())
    return {name: (after[name] - before[name]) / (2 * step) for name in after}
