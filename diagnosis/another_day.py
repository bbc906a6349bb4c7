"""What is known of an identified model on another day than that of its identification: friction varies from day to day.

Recordings of one day do not show by how much; it is assumed as by ``compare`` (``arm_model.tables.friction_of_days``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter
from arm_model.tables import Uncertainty
from arm_model.tables.friction_of_days import COULOMB, NEAR_REST, UNRECORDED, VISCOUS, near_rest
from daq.recording import Recording
from daq.recording.shared_rows import digest

FASTER = 0.5
"""Standard deviation, as a share, of the slope of friction at speeds above those of the identification: the slope of
|v|^0.6 is 0.6 of that of the straight line through it, that of |v|^1.5 is 1.5 of it."""


def known_in(arm: Arm, recordings: Sequence[Recording]) -> Arm:
    """The arm as it is known in some recordings; where all are of its identification, by its covariance alone.

    What its model left over in them is then what a diagnosis is asked for, and friction is that of the day.
    """
    known = arm.uncertainty
    if known is None or not {digest(one) for one in recordings} <= set(known.recordings):
        return arm
    nothing = tuple(value and 0.0 for value in known.near_rest)
    own = replace(known, left_over=(), in_loop=(), against=(), near_rest=nothing, ripple=(), aliased=(), same_day=True)
    return replace(arm, uncertainty=own)


def known_on_another_day(arm: Arm) -> Uncertainty | None:
    """The uncertainty that an arm states, with that of level and slope of its friction on another day.

    Both are independent of each other and of other joints. None if the arm states no uncertainty; without them of the
    recordings of its identification.
    """
    uncertainty = arm.uncertainty
    if uncertainty is None or uncertainty.same_day:
        return uncertainty
    covariance = uncertainty.matrix
    for joint in range(1, len(arm) + 1):
        for kind, share in (("coulomb", COULOMB), ("viscous", VISCOUS)):
            step = UNRECORDED * share * _sizes(arm, uncertainty.parameters, f"joint{joint}.{kind}")
            covariance += np.outer(step, step)
    return replace(uncertainty, covariance=tuple(tuple(row[: k + 1].tolist()) for k, row in enumerate(covariance)))


def friction_near_rest(arm: Arm, parameters: tuple[str, ...], columns: Array, speed: Array) -> Array:
    """(m, n, j) A: change of the currents by one standard deviation of each joint's friction near rest on another day.

    columns (m, n, p) A: change of the currents for a unit of each of the ``parameters``; speed (m, n) rad/s (m/s). Of
    joints whose Coulomb friction is among the parameters.
    """
    found: list[Array] = []
    if arm.uncertainty is not None and arm.uncertainty.same_day:
        return np.zeros((*speed.shape, 0))
    for joint in range(1, len(arm) + 1):
        sizes = _sizes(arm, parameters, f"joint{joint}.coulomb")
        fastest = float(np.abs(speed[:, joint - 1]).max(initial=0.0))
        if sizes.any() and fastest > 0.0:
            shape = near_rest(np.abs(speed[:, joint - 1]) / fastest)
            found.append(UNRECORDED * NEAR_REST * shape[:, None] * (columns @ sizes))
    return np.stack(found, axis=-1) if found else np.zeros((*speed.shape, 0))


def friction_beyond(arm: Arm, parameters: tuple[str, ...], columns: Array, speed: Array) -> Array:
    """(m, n, j) A: as ``friction_near_rest``, of each joint's friction at speeds above those of the identification.

    Of joints with a friction curve, which ends there: beyond, only the slope of a straight line is known.
    """
    found: list[Array] = []
    if arm.uncertainty is not None and arm.uncertainty.same_day:
        return np.zeros((*speed.shape, 0))
    for joint, curve in enumerate((joint.friction_curve for joint in arm.joints), 1):
        fast = np.abs(speed[:, joint - 1])
        if curve is not None:
            shape = FASTER * np.maximum(1.0 - curve.speed[-1] / np.maximum(fast, curve.speed[-1]), 0.0)
            found.append(shape[:, None] * (columns @ _sizes(arm, parameters, f"joint{joint}.viscous")))
    return np.stack(found, axis=-1) if found else np.zeros((*speed.shape, 0))


def _sizes(arm: Arm, parameters: tuple[str, ...], begin: str) -> Array:
    """(p,) of the parameters whose names begin so, the others 0."""
    return np.array([parameter(arm, name) if name.startswith(begin) else 0.0 for name in parameters])
