"""What held-out rows leave beside the doubt about the coefficients of the causes.

A cause of several coefficients is known by the rows that it was fitted to. Held-out rows may ask for other sums of
them, which it is hardly known to: then it leaves there what its own covariance says that it may.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm_io.types import Array
from diagnosis.measurements.currents.estimates import covariance_of
from diagnosis.measurements.currents.state import State


@dataclass(frozen=True)
class CoefficientDoubt:
    """The coefficients of the causes of a state, as uncertain as the fitted rows leave them."""

    state: State

    def beside(self, residual: Array) -> Array:
        """(N,) of a held-out residual (N,), whitened: without what the coefficients are likely to be wrong by.

        With d = Z z the error of what is explained, z ~ N(0, 1), and rows of which ``Run.alike`` count as one: without
        the mean of d, given the residual.
        """
        if not self.state.chosen:
            return residual
        z, alike = self._columns, float(np.mean([run.alike for run in self.state.data.held_out.runs]))
        normal = z.T @ z / alike + np.eye(z.shape[1])
        return np.asarray(residual - z @ np.linalg.solve(normal, z.T @ residual / alike))

    @cached_property
    def _columns(self) -> Array:
        """(N, k): what each independent error of the coefficients, of one std, adds to held-out rows."""
        model, held_out = self.state.model, self.state.data.held_out
        covariance, places = covariance_of(self.state)
        columns = [model.columns(c).held_out.dense(len(held_out.y)) for c in self.state.chosen]
        linear = np.concatenate([place.start + np.arange(own.shape[1]) for place, own in zip(places, columns)])
        of_linear = covariance[np.ix_(linear, linear)]
        std = np.sqrt(np.maximum(np.diag(of_linear), 1e-300))
        values, vectors = np.linalg.eigh(of_linear / np.outer(std, std))
        return np.asarray(np.hstack(columns) @ (std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))))
