"""Rows in which only the noise of the instruments makes a residual current differ from zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.residual.run import Run

LARGEST_STD = 3.0
"""Std of a residual without any error, over the noise of the instruments, up to which a row is compared.

It is larger near standstill, where stiction makes the current indeterminate.
"""


def comparable_rows(run: Run) -> NDArray[np.bool_]:
    """(m, n): rows of a run that are compared, per joint."""
    rows: NDArray[np.bool_] = run.deviation < LARGEST_STD * run.instruments
    return rows


def rms_where(values: Array, rows: NDArray[np.bool_]) -> Array:
    """(n,) root mean square of values (m, n) over ``rows`` (m, n); over all rows of a column that has none."""
    weight = np.where(rows.any(axis=0), rows, True).astype(float)
    rms: Array = np.sqrt(np.sum(values**2 * weight, axis=0) / weight.sum(axis=0))
    return rms
