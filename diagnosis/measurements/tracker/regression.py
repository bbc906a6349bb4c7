"""Residuals of tracked points about a fit, and what candidates add to them to first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.measurements.tracker.candidates import TrackedCandidate, turns
from diagnosis.measurements.tracker.joint_fit import State, points_of, zero_scales
from diagnosis.measurements.tracker.points import Side
from identification.kinematics.estimation import REJECT, residuals
from identification.kinematics.models import position_jacobian
from identification.selection import MEDIAN_OF_NORM


def point_residual(state: State, side: Side) -> Array:
    """(N, 3) m: measured less fitted points of a side."""
    return residuals(state.parameters, state.values, state.estimate.extension, state.points(side))


def residual_without_zeros(state: State, side: Side, steps: Array, level: float) -> Array:
    """(N, 3) m: ``point_residual`` without what the encoders' own zeros in each recording explain of it.

    steps (n,) rad: of the encoders, whose prior of a zero they are (``zero_scales``); level: m, noise of a coordinate.
    Along one motion, the points that a wrong zero moves may well drift over time.
    """
    residual = point_residual(state, side)
    chain = state.parameters.chain.at(state.values)
    every = position_jacobian(chain, state.points(side).bent(state.estimate.extension))[1]
    columns = (every[:, :, chain.joint_steps()] @ side.coupling) * zero_scales(steps)
    seen = good(residual)
    for recording in np.unique(side.of):
        of_recording = side.of == recording
        fitted = columns[of_recording & seen].reshape(-1, columns.shape[2])
        normal = fitted.T @ fitted + level**2 * np.eye(fitted.shape[1])
        residual[of_recording] -= columns[of_recording] @ np.linalg.solve(
            normal, fitted.T @ residual[of_recording & seen].ravel()
        )
    return residual


def good(residual: Array) -> NDArray[np.bool_]:
    """(N,) rows that are no outliers."""
    length = np.linalg.norm(residual, axis=1)
    return np.asarray(length <= _largest(length))


@dataclass(frozen=True)
class Linear:
    """Points about a fit.

    residual  (N, 3) m
    free      (N, 3, k) m: columns of all free parameters, per prior std
    every     (N, 3, steps): columns of every value of the chain
    good      (N,) rows that are no outliers
    """

    residual: Array
    free: Array
    every: Array
    good: NDArray[np.bool_]


def linear(state: State, side: Side) -> Linear:
    """The points of one side linearised about a state; free values in units of their prior deviations."""
    points, extension = points_of(state.chosen, side), state.estimate.extension
    chain = state.parameters.chain.at(state.values)
    at, every = position_jacobian(chain, points.bent(extension))
    free = state.parameters.free
    columns = (every[:, :, free] * state.parameters.scale[free]) @ state.parameters.prior_root()
    if points.deflections is not None:
        bend = every[:, :, chain.joint_steps()] @ points.deflections
        scales = np.concatenate([c.scales for c in state.chosen if not c.names])
        columns = np.concatenate((columns, bend * scales), axis=2)
    residual = side.xyz - at
    return Linear(residual, columns, every, good(residual))


def columns_of(candidate: TrackedCandidate, state: State, side: Side, about: Linear) -> Array:
    """(N, 3, k): what a prior std of each of its coefficients moves the points of a side."""
    chain = state.parameters.chain
    if candidate.names:
        where = [chain.names.index(name) for name in candidate.values]
        return about.every[:, :, where] * candidate.scales
    return np.asarray(about.every[:, :, chain.joint_steps()] @ turns(candidate, side), float) * candidate.scales


def squares(residual: Array) -> Array:
    """(N,) squared distances, those of outliers clipped."""
    length = np.linalg.norm(residual, axis=1)
    return np.asarray(np.minimum(length, _largest(length)) ** 2)


def energy(residual: Array) -> float:
    """Sum of ``squares``."""
    return float(np.sum(squares(residual)))


def by_block(values: Array, side: Side) -> Array:
    """Sums of values (N,) over the side's one-second blocks."""
    return np.bincount(np.unique(side.block, return_inverse=True)[1], weights=values).astype(float)


def _largest(length: Array) -> float:
    return REJECT * max(float(np.median(length)) / MEDIAN_OF_NORM, 1e-9)
