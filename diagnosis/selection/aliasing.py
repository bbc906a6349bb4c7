"""Aliasing of columns, conditional on those in the model.

With P = I - Q Q^T the projector off the span of the columns in the model, only P phi of an effect phi is detectable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from arm_io.types import Array

DEPENDENT = 1e-9
"""Relative diagonal entry of R below which a column depends on others."""


@dataclass(frozen=True)
class Span:
    """Orthonormal basis of the columns already in the model: q (n, r); r = 0 for an empty model."""

    q: Array

    def remove(self, columns: Array) -> Array:
        """P columns: the part of ``columns`` (n, m) or (n,) that is not in the span."""
        outside = columns - self.q @ (self.q.T @ columns)
        return outside - self.q @ (self.q.T @ outside)  # twice is enough (Kahan): orthogonal to working precision


def span_of(columns: Array) -> Span:
    """The span of ``columns`` (n, m), by pivoted QR on unit columns; dependent ones are left out."""
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    if columns.shape[1] == 0:
        return Span(np.empty((len(columns), 0)))
    q, r, _ = linalg.qr(columns, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(r)) > DEPENDENT * abs(r[0, 0])))
    return Span(np.ascontiguousarray(q[:, :rank]))


def confusability(span: Span, first: Array, second: Array) -> float:
    """Largest canonical correlation of P first (n, m1) and P second (n, m2): at 1 they are indistinguishable."""
    a, b = (span_of(span.remove(columns)).q for columns in (first, second))
    if a.shape[1] == 0 or b.shape[1] == 0:
        return 0.0
    return min(1.0, float(np.linalg.svd(a.T @ b, compute_uv=False)[0]))
