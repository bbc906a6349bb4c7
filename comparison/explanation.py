"""Changes of the compared values explained by one cause: generalised least squares, and whether it is stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from arm_io.types import Array
from comparison.change import Change

SIGNIFICANT = 1e-4
"""Probability by chance, of all candidates together, below which the changes of a cause are there."""
EXPLAINED = 2.5
"""Mean square of what a cause leaves of the changes that it can make, in deviations, up to which it explains them."""
DEPENDENT = 1e-6
"""Of the largest singular value: combinations of a body's parameters that no compared value shows."""


@dataclass(frozen=True)
class SeenChanges:
    """v compared values that every recording shows, of c: their places (v,), changes (v,), covariance, (v, v)."""

    places: NDArray[np.intp]
    quantities: Sequence[Change]
    change: Array
    covariance: Array

    def select(self, which: NDArray[np.bool_]) -> SeenChanges:
        return SeenChanges(
            self.places[which],
            [quantity for quantity, kept in zip(self.quantities, which) if kept],
            self.change[which],
            self.covariance[np.ix_(which, which)],
        )


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Generalised least squares of v changes by the k columns of one cause.

    coefficients (k,), covariance (k, k)  of columns that the changes do not determine: 0, and a huge variance
    before, left  sum of the squared changes, in deviations, without the cause and with it
    rank          number of its independent columns
    changes       v
    """

    coefficients: Array
    covariance: Array
    before: float
    left: float
    rank: int
    changes: int

    @property
    def mean_left(self) -> float:
        """Mean square of what the cause leaves, in deviations: 1 if it explains all but chance."""
        return self.left / max(self.changes - self.rank, 1)

    def is_stated(self, candidates: int) -> bool:
        """Whether, of so many candidates, the changes of the cause are significant, and what it leaves is not."""
        chance = float(stats.chi2.sf((self.before - self.left) / max(self.mean_left, 1.0), self.rank))
        return candidates * chance < SIGNIFICANT and self.mean_left < EXPLAINED and self.changes > self.rank


def explanation(x: Array, seen: SeenChanges) -> Explanation:
    """The changes by the columns x (v, k) of a cause."""
    root = linalg.cholesky(seen.covariance + 1e-12 * np.diag(np.diag(seen.covariance)), lower=True)
    a = linalg.solve_triangular(root, x, lower=True)
    y = linalg.solve_triangular(root, seen.change, lower=True)
    size = np.linalg.norm(a, axis=0)
    size[size == 0.0] = 1.0
    u, s, vt = np.linalg.svd(a / size, full_matrices=False)
    independent = s > DEPENDENT * s[0]
    inverse = np.where(independent, 1.0 / np.maximum(s, 1e-300), 1e12) ** 2
    return Explanation(
        coefficients=(vt[independent].T @ ((u[:, independent].T @ y) / s[independent])) / size,
        covariance=(vt.T * inverse) @ vt / np.outer(size, size),
        before=float(y @ y),
        left=float(np.sum((y - u[:, independent] @ (u[:, independent].T @ y)) ** 2)),
        rank=int(independent.sum()),
        changes=len(y),
    )
