"""What the errors of a model, which says how well it is known, make between two encoders.

The model enters by the load alone. What a spring or a gap explains is wrong by its slope over the load times the error
of the load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from diagnosis.measurements.link_encoders.columns import FULL_LOAD, LinkCandidate, Rows


def directions(chosen: Sequence[LinkCandidate], coefficients: Array, rows: Rows) -> Array:
    """(k, m, r) rad (m): error of what ``chosen`` explain, by each independent error of the load.

    coefficients: of a constant per joint, then of the chosen.
    """
    total = np.zeros((len(rows.joints), rows.rows, rows.load_errors.shape[2]))
    at = len(rows.joints)
    for candidate in chosen:
        for k in np.flatnonzero(rows.joints == candidate.joint):
            slope = _slope(candidate, rows, int(k))
            total[k] += coefficients[at] * slope[:, None] * rows.load_errors[:, k]
        at += candidate.width
    return total


def _slope(candidate: LinkCandidate, rows: Rows, k: int) -> Array:
    """(m,) derivative of a candidate's first column by the load of the k-th joint."""
    match candidate.variant[0]:
        case "drag":
            return np.ones(rows.rows)
        case "by_load":
            soft = FULL_LOAD * float(rows.largest[k])
            return np.asarray(soft**2 / np.hypot(rows.load[:, k], soft) ** 3)
    return np.zeros(rows.rows)
