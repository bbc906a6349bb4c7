"""Rows in which a residual current has no reason but the instruments to be other than zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.residual.run import Run

CERTAIN = 3.0
"""Times the instruments' noise.

Rows whose residual may deviate more with nothing wrong (friction near standstill) are not compared.
"""


def comparable_rows(run: Run) -> NDArray[np.bool_]:
    """(m, n): rows of a run that are compared, per joint."""
    rows: NDArray[np.bool_] = run.deviation < CERTAIN * run.noise
    return rows


def rms_where(values: Array, rows: NDArray[np.bool_]) -> Array:
    """(n,) root mean square of values (m, n) over ``rows`` (m, n); over all rows of a column that has none."""
    weight = np.where(rows.any(axis=0), rows, True).astype(float)
    rms: Array = np.sqrt(np.sum(values**2 * weight, axis=0) / weight.sum(axis=0))
    return rms
