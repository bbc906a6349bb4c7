"""Refinement of nonlinear parameters: each between grid values, then all together in the exact model."""

from __future__ import annotations

import itertools

import numpy as np
from scipy import optimize

from arm_io.parallel import in_parallel
from arm_io.types import Array
from diagnosis.measurements.currents.design_matrix import columns_of, dataset_with
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.currents.state import State, terms
from diagnosis.selection.candidate import RELATIVE_STEP, Candidate
from diagnosis.selection.design import Dataset
from diagnosis.selection.regression import Fitted, fit_gain

FINE = 1.5
"""Factor to both sides of a value of a fine search grid: it reaches the next value."""
COARSE = 3.0
"""The same of a coarse grid, whose next value it does not reach."""


def refined(candidate: Candidate, fitted: Fitted, fit: Dataset) -> Candidate:
    """The candidate with each continuous nonlinear parameter at its optimum near its grid value, in turn.

    No optimum is beyond what the effect may have (``Parameter.most``): there, it would be refused for its noise.
    """
    searched = candidate.searched()
    for name in searched * (2 if len(searched) > 1 else 1):
        value = dict(candidate.shape)[name]

        def worse(log_value: float, name: str = name, now: Candidate = candidate) -> float:
            trial = now.at(name, float(np.exp(float(log_value))))
            gain, c = fit_gain(columns_of(trial, fit), fitted)
            # by shape alone: what a coefficient of 1 gains, for a gain that is quadratic in the coefficient
            return -gain * (1.0 - (1.0 / c[0] - 1.0) ** 2) if now.unit_amplitude and c[0] else -gain

        reach, most = _reach(candidate, name), candidate.definition[name].most
        optimum = optimize.minimize_scalar(
            worse,
            bounds=(np.log(value / reach), np.log(min(value * reach, most))),
            method="bounded",
            options={"xatol": 0.01, "maxiter": 14},
        )
        candidate = candidate.at(name, float(np.exp(optimum.x)))
    return candidate


def _reach(candidate: Candidate, name: str) -> float:
    """Factor to both sides of a grid value in which an optimum is looked for, less on the fine grids of springs.

    Their damping has two values only: a small arm's is far below both.
    """
    (grid,) = (p.search for p in candidate.definition.parameters if p.name == name)
    fine = all(b / a <= FINE**2 for a, b in itertools.pairwise(grid))
    return FINE if fine and candidate.definition.spring is not None else COARSE


def gauss_newton_refined(state: State) -> State:
    """The state after one Gauss-Newton step of its nonlinear parameters in the exact model, if the residual falls.

    Unchanged if the chosen effects together give an impossible arm.
    """
    searched = [(k, name) for k, c in enumerate(state.chosen) for name in c.searched()]
    if not searched:
        return state
    model, coefficients, basis = state.model, state.coefficients, state.fitted.basis
    if not exists(model.arm, state.terms):
        return state
    at_estimate = dataset_with(model.data.fit, state.terms)

    def slope_of(place: tuple[int, str]) -> Array:
        k, name = place
        value = dict(state.chosen[k].shape)[name]
        step = RELATIVE_STEP * value
        moved = [c.at(name, value + step) if n == k else c for n, c in enumerate(state.chosen)]
        return (dataset_with(model.data.fit, terms(moved, coefficients)) - at_estimate) / step

    slope = np.stack(in_parallel(slope_of, searched), axis=1)
    slope -= basis @ (basis.T @ slope)
    change = -np.linalg.lstsq(slope, at_estimate - basis @ (basis.T @ at_estimate), rcond=1e-3)[0]
    better = list(state.chosen)
    for (k, name), by in zip(searched, change):
        value = dict(better[k].shape)[name]
        most = min(2 * value, better[k].definition[name].most)
        better[k] = better[k].at(name, float(np.clip(value + by, value / 2, most)))
    as_is, moved_on = (model.refitted(chosen, state.rivals) for chosen in (state.chosen, better))
    return moved_on if np.sum(moved_on.residual.fit**2) < np.sum(as_is.residual.fit**2) else state
