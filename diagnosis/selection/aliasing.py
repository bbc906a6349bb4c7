"""Aliasing of columns, conditional on those in the model.

With P = I - Q Q^T the projector off the span of the columns in the model, only P phi of an effect phi is detectable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

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


def confusability(span: Span, one: Array, other: Array) -> float:
    """Largest canonical correlation of P one (n, m1) and P other (n, m2): at 1 they are indistinguishable."""
    a, b = span_of(span.remove(_two_dimensional(one))), span_of(span.remove(_two_dimensional(other)))
    if a.q.shape[1] == 0 or b.q.shape[1] == 0:
        return 0.0
    return min(1.0, float(np.linalg.svd(a.q.T @ b.q, compute_uv=False)[0]))


def _two_dimensional(columns: Array) -> Array:
    return columns[:, None] if columns.ndim == 1 else columns
