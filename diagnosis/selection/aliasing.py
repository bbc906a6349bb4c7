"""Detectability and aliasing of columns before any fit: survival, smallest detectable amplitude, confusability.

With W the columns that are free and P = I - Q Q^T the projector off their span, only P phi of an effect phi is
detectable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats

from arm_io.types import Array


@dataclass(frozen=True)
class Span:
    """Orthonormal basis of the columns already in the model: q (n, r); r = 0 for an empty model."""

    q: Array

    def remove(self, columns: Array) -> Array:
        """P columns: the part of ``columns`` (n, m) or (n,) that is not in the span."""
        if self.q.shape[1] == 0:
            return columns
        rest = columns - self.q @ (self.q.T @ columns)
        return rest - self.q @ (self.q.T @ rest)  # twice is enough (Kahan): orthogonal to working precision


def span_of(columns: Array, tolerance: float = 1e-9) -> Span:
    """The span of ``columns`` (n, m), by pivoted QR on unit columns; dependent ones are left out."""
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    if columns.shape[1] == 0:
        return Span(np.empty((len(columns), 0)))
    q, r, _ = linalg.qr(columns, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(r)) > tolerance * abs(r[0, 0])))
    return Span(np.ascontiguousarray(q[:, :rank]))


def survival(span: Span, column: Array) -> float:
    """P phi| / |phi| of one column (n,): 0 lies in the span and is not detectable, 1 is orthogonal to it."""
    norm = float(np.linalg.norm(column))
    return float(np.linalg.norm(span.remove(column))) / norm if norm > 0 else 0.0


def smallest_detectable(
    span: Span, column: Array, inflation: float = 1.0, false_alarm: float = 0.01, power: float = 0.9
) -> float:
    """Smallest amplitude of ``column`` (whitened: noise of unit variance) found with probability ``power``.

    c_min = (z_alpha + z_beta) sqrt(inflation) / |P phi|; ``inflation`` is the variance inflation of coloured noise
    (samples a correlation time). Infinite where nothing survives.
    """
    norm = float(np.linalg.norm(span.remove(column)))
    if norm <= 1e-9 * max(float(np.linalg.norm(column)), 1e-300):
        return float("inf")
    z = float(stats.norm.isf(false_alarm)) + float(stats.norm.isf(1.0 - power))
    return z * float(np.sqrt(inflation)) / norm


def confusability(span: Span, one: Array, other: Array) -> float:
    """Largest canonical correlation of P one (n, m1) and P other (n, m2): at 1 they are indistinguishable."""
    a, b = span_of(span.remove(_two_dimensional(one))), span_of(span.remove(_two_dimensional(other)))
    if a.q.shape[1] == 0 or b.q.shape[1] == 0:
        return 0.0
    return min(1.0, float(np.linalg.svd(a.q.T @ b.q, compute_uv=False)[0]))


def _two_dimensional(columns: Array) -> Array:
    return columns[:, None] if columns.ndim == 1 else columns
