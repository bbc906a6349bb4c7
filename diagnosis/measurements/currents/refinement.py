"""Candidates of the currents: physical admissibility, and refinement of nonlinear parameters between grid values."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from arm_io.types import Array
from diagnosis.measurements.currents.design_matrix import columns_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from diagnosis.selection.regression import Fitted, fit_gain


def is_physical(candidate: Candidate, coefficients: Array) -> bool:
    """Whether the parameters have admissible signs and sizes: no negative mass, stiffness, gap or friction share."""
    if candidate.unit_amplitude and not 0.25 < coefficients[0] < 4.0:
        return False  # its true coefficient is 1; between the points of the grid it may differ
    values = candidate.parameters(coefficients.tolist())
    return all(candidate.definition.admits(name, value) for name, value in values.items())


def refined(candidate: Candidate, fitted: Fitted, fit: Dataset) -> Candidate:
    """The candidate with each continuous nonlinear parameter at its optimum near its grid value, in turn."""
    searched = candidate.searched()
    for name in searched * (2 if len(searched) > 1 else 1):
        value = dict(candidate.shape)[name]

        def worse(log_value: float, name: str = name, now: Candidate = candidate) -> float:
            trial = now.at(name, float(np.exp(float(log_value))))
            gain, c = fit_gain(columns_of(trial, fit), fitted)
            # by shape alone: what a coefficient of 1 gains, for a gain that is quadratic in the coefficient
            return -gain * (1.0 - (1.0 / c[0] - 1.0) ** 2) if now.unit_amplitude and c[0] else -gain

        reach = 1.5 if candidate.definition.spring is not None else 3.0  # their grids are finer
        optimum = optimize.minimize_scalar(
            worse,
            bounds=(np.log(value / reach), np.log(value * reach)),
            method="bounded",
            options={"xatol": 0.01, "maxiter": 14},
        )
        candidate = candidate.at(name, float(np.exp(optimum.x)))
    return candidate
