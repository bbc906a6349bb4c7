"""The shapes in which a quantity may move, and the weighted regression of a history on some of them.

A history is a constant plus a few terms: a *step* between two results, or a *drift* that begins at a result (at the
first: a straight line). The variance of a result is that of its own deviation plus one between results (random
effects), because a night differs from the next by more than its own deviation says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from arm_io.types import Array
from comparison.trend.history import History

Shape = Literal["step", "drift"]
LEAST_RESULTS = 2
"""On each side of a step: one result that is off is no trend. Of three results in all, one on a side is enough."""


@dataclass(frozen=True, order=True)
class Term:
    """A shape and the result (from 0) with which it begins."""

    shape: Shape
    at: int

    def column(self, days: Array) -> Array:
        """(n,) 1 from the step on, or days since the drift began."""
        if self.shape == "step":
            return np.asarray(np.arange(len(days)) >= self.at, float)
        return np.maximum(days - days[self.at], 0.0)


@dataclass(frozen=True)
class Scatter:
    """Variance between results over what deviations explain, of quantities of one kind, with ``freedom`` degrees."""

    value: float
    freedom: float


@dataclass(frozen=True)
class Fit:
    """A history fitted by a constant and terms.

    between       variance between results that the weights contain, in the square of the unit
    coefficients  (p,), the constant first; covariance (p, p)
    rest          sum of squares that is left, weighted by the deviations alone; freedom: its degrees
    """

    terms: tuple[Term, ...]
    between: float
    coefficients: Array
    covariance: Array
    rest: float
    freedom: int


def candidates(history: History) -> list[Term]:
    """Every term that a history may have; results of the same moment cannot be separated by a step."""
    days, n = history.days, len(history.days)
    least = LEAST_RESULTS if n > 3 else 1
    steps = [Term("step", k) for k in range(least, n - least + 1) if days[k] > days[k - 1]]
    drifts = [Term("drift", k) for k in range(max(n - LEAST_RESULTS, 1)) if k == 0 or days[k] > days[k - 1]]
    return steps + [term for term in drifts if days[-1] > days[term.at]]


def design(history: History, terms: tuple[Term, ...]) -> Array:
    """(n, p) columns: the constant, then the terms."""
    return np.stack([np.ones(len(history.days)), *(term.column(history.days) for term in terms)], axis=1)


def fit(history: History, terms: tuple[Term, ...], between: float = 0.0) -> Fit:
    """Weighted least squares; the terms must be linearly independent."""
    columns = design(history, terms)
    total = np.sqrt(history.raw**2 + between)
    covariance = np.linalg.pinv((columns / total[:, None]).T @ (columns / total[:, None]), hermitian=True)
    coefficients = covariance @ columns.T @ (history.values / total**2)
    q, _ = np.linalg.qr(columns / history.raw[:, None])
    y = history.values / history.raw
    residual_energy = float(np.sum((y - q @ (q.T @ y)) ** 2))
    return Fit(terms, between, coefficients, np.asarray(covariance, float), residual_energy, len(y) - columns.shape[1])


def between_of(history: History, fitted: Fit, known: Scatter) -> float:
    """The variance between results with which the residual would be as large as the scatter of the history.

    The scatter is estimated from its own residual and what is ``known`` of its kind. As DerSimonian and Laird for a
    mean, here for a regression: the trace is that of the residual's weights.
    """
    scatter = known.value
    if np.isfinite(known.freedom):
        scatter = (known.freedom * known.value + fitted.rest) / (known.freedom + fitted.freedom)
    if scatter <= 1:
        return 0.0
    if fitted.freedom < 1:
        return float(np.median(history.raw) ** 2 * (scatter - 1))
    q, _ = np.linalg.qr(design(history, fitted.terms) / history.raw[:, None])
    weight = history.raw**-2
    spare = float(weight.sum() - np.sum(q**2 * weight[:, None]))
    return (scatter - 1) * fitted.freedom / spare


def tests(history: History, fitted: Fit, tried: list[Term], freedom: float) -> tuple[Array, Array]:
    """(m,) p-value of each tried term when added to a fit, and the weighted squares that it explains.

    Student's t. The variance that the fit assumes is known with ``freedom`` degrees; the residual that a term leaves
    corrects it (Smyth's moderated t), but never below what the deviations explain alone. Degrees of freedom are also
    limited by those of the deviations (Welch and Satterthwaite).
    """
    total = np.sqrt(history.raw**2 + fitted.between)
    q, _ = np.linalg.qr(design(history, fitted.terms) / total[:, None])
    y = history.values / total
    y = y - q @ (q.T @ y)
    columns = np.stack([term.column(history.days) for term in tried], axis=1) / total[:, None]
    size = np.linalg.norm(columns, axis=0)
    columns = columns - q @ (q.T @ columns)
    length = np.linalg.norm(columns, axis=0)
    degrees = len(y) - q.shape[1] - 1
    separate = (length > 1e-6 * size) & (degrees >= 0)
    unit = columns / np.where(separate, length, 1.0)
    gain = np.where(separate, (unit.T @ y) ** 2, 0.0)
    residual_energy = np.maximum(y @ y - gain, 0.0)
    share = unit**2
    variances = share * (history.raw**2 / total**2)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        welch = np.sum(variances, axis=0) ** 2 / np.sum(variances**2 / history.freedom[:, None], axis=0)
        t = np.sqrt(gain / np.maximum(_corrected(residual_energy, degrees, freedom), variances.sum(axis=0)))
    p = 2 * stats.t.sf(t, np.minimum(welch, freedom + degrees))
    return np.where(separate, p, 1.0), gain


def _corrected(rest: Array, degrees: int, freedom: float) -> Array:
    """(m,) variance over the one assumed, from a residual with ``degrees`` and the assumption with ``freedom``."""
    return np.ones_like(rest) if np.isinf(freedom) else (freedom + rest) / (freedom + degrees)
