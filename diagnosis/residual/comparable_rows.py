"""Rows in which only the noise of the instruments makes a residual current differ from zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from diagnosis.residual.run import Run

LARGEST_STD = 3.0
"""Std of a residual without any error, over the noise of the instruments, up to which a row is compared.

It is larger near standstill, where stiction makes the current indeterminate.
"""
FRICTION_STD = 1e-3
"""Std of a joint's friction, over its friction at rest, up to which a row is compared however small the noise is.

Instruments without noise, which simulated recordings may have, would leave no rows.
"""


def comparable_rows(run: Run) -> NDArray[np.bool_]:
    """(m, n): rows of a run that are compared, per joint."""
    known = FRICTION_STD * rest_friction(run.arm)
    rows: NDArray[np.bool_] = run.deviation < np.maximum(
        LARGEST_STD * run.instruments, np.hypot(run.instruments, known)
    )
    return rows


def noise_compared(run: Run, noise: Array) -> Array:
    """(n,) A: the ``noise`` (n,) A of a run's instruments, above which errors over its rows by ``rms_where`` are found.

    Of a joint that creeps or stands throughout, all rows are compared: it has the std of friction near rest.
    """
    known = comparable_rows(run).any(axis=0)
    return np.where(known, noise, np.maximum(noise, np.median(run.deviation, axis=0)))


def rest_friction(arm: Arm) -> Array:
    """(n,) A: friction of every joint at rest, of its larger direction.

    At least its Coulomb friction: the first value of a curve is extrapolated where few rows are so slow.
    """
    levels = np.array([max(*joint.rest_friction, *(joint.ratio * c for c in joint.coulomb)) for joint in arm.joints])
    friction: Array = levels / described(arm).joint_array("drive_constant")
    return friction


def rms_where(values: Array, rows: NDArray[np.bool_]) -> Array:
    """(n,) root mean square of values (m, n) over ``rows`` (m, n); over all rows of a column that has none."""
    weight = np.where(rows.any(axis=0), rows, True).astype(float)
    rms: Array = np.sqrt(np.sum(values**2 * weight, axis=0) / weight.sum(axis=0))
    return rms
