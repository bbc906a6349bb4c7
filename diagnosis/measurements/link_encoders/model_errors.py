"""What the errors of a model, which says how well it is known, make between two encoders.

The model enters by the load alone. What a spring or a gap explains is wrong by its slope over the load times the error
of the load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from diagnosis.measurements.link_encoders.candidates import LinkCandidate
from diagnosis.measurements.link_encoders.rows import Rows


def directions(chosen: Sequence[LinkCandidate], coefficients: Array, rows: Rows) -> Array:
    """(k, m, r) rad (m): error of what ``chosen`` explain, by each independent error of the load.

    coefficients: of a constant per joint, then of the chosen.
    """
    total = np.zeros((len(rows.joints), rows.rows, rows.load_errors.shape[2]))
    at = len(rows.joints)
    for candidate in chosen:
        # the side of a gap at which its load holds a link depends on no small error
        for k in np.flatnonzero((rows.joints == candidate.joint) & (candidate.variant[0] == "drag")):
            total[k] += coefficients[at] * rows.load_errors[:, k]
        at += candidate.width
    return total
