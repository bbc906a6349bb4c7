"""How friction of stored results differs between two sides of an arm in which nothing changed (``friction_drift``).

A result states Coulomb and viscous friction, friction at a few speeds, or causes that add to the friction of a model.
Each differs by the assumed shares of the friction that its joint has: of an identification its ``friction_curves``, of
a diagnosis that of the model. Results of several days show for themselves how much friction differs: of these nothing
is assumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import gamma

from arm_io.dates import utc_date_of
from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import total_at
from arm_model.tables.friction_of_days import COULOMB, HUMP, NEAR_REST, SHARPNESS, UNRECORDED, VISCOUS, near_rest
from comparison.change import Estimate, Quantity
from comparison.friction_drift import friction_size

DAYS = 3
"""Days on which the results of a side were recorded, from which on their scatter says how much friction differs."""
CAUSES = {
    "coulomb_friction.coulomb": "level",
    "viscous_friction.viscous": "slope",
    "stribeck_friction.breakaway": "hump",
}
"""Parameters of causes that a difference of temperature changes, and what of the friction each is."""


@dataclass(frozen=True)
class _Friction:
    """Of one joint: level N m (N), slope N m s/rad (N s/m), and the fastest speed that is known; NaN: none is."""

    level: float
    slope: float
    fastest: float

    def more(self, which: str, value: float) -> _Friction:
        """With a ``value`` more of its level or slope; as it is, of anything else."""
        return replace(self, **{which: getattr(self, which) + value}) if which in ("level", "slope") else self


def stored_drift(
    tables: Sequence[Mapping[str, Any]],
    arm: Arm | None,
    quantities: Sequence[Quantity],
    estimates: Sequence[Estimate],
    before: int,
) -> Array:
    """(r,) standard deviation by which each quantity differs between the sides.

    tables  of the results, those before first
    arm     the model of diagnoses; None: there is none, or the results are identifications
    """
    nothing = np.zeros(len(quantities))
    if max(_days(tables[:before]), _days(tables[before:])) >= DAYS:
        return nothing
    values = np.array([estimate.values for estimate in estimates])
    finite = np.isfinite(values)
    mean = np.where(finite, values, 0.0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1)
    drift = [_drift(quantity, float(value), tables, arm) for quantity, value in zip(quantities, mean)]
    return np.array(drift, float).reshape(nothing.shape)


def _drift(quantity: Quantity, value: float, tables: Sequence[Mapping[str, Any]], arm: Arm | None) -> float:
    """Standard deviation of one quantity with a mean ``value``."""
    if quantity.joint is None:
        return 0.0
    which = _which(quantity)
    if quantity.kind == "cause":
        # the model's friction, and what the cause adds to it
        friction = _of_model(arm, quantity.joint).more(which, value)
    else:
        friction = _identified(tables, quantity.joint)
        if np.isnan(friction.fastest):
            # an older result: what it states of this parameter
            friction = friction.more(which, value)
    level = UNRECORDED * COULOMB * abs(friction.level)
    slope = UNRECORDED * VISCOUS * abs(friction.slope)
    hump = UNRECORDED * NEAR_REST * abs(friction.level)
    if quantity.speed is not None:
        speed = abs(quantity.speed)
        return float(np.linalg.norm([level, slope * speed, hump * float(near_rest(speed / friction.fastest))]))
    by_hump = _line()
    if which == "level":
        return float(np.hypot(level, by_hump[0] * hump))
    if which == "slope":
        return float(np.hypot(slope, np.nan_to_num(by_hump[1] * hump / friction.fastest)))
    return hump if which == "hump" else 0.0


def _which(quantity: Quantity) -> str:
    """level, slope or hump of a joint's friction; "" of anything else, an asymmetry say. Of a sum: its first term."""
    first = quantity.name.replace(" - ", " + ").split(" + ")[0].partition(".")[2]
    if quantity.kind == "cause":
        return CAUSES.get(first, "")
    return {"coulomb": "level", "viscous": "slope"}.get(first.partition("_")[0], "")


def _line() -> tuple[float, float]:
    """Level and slope of the line nearest to it, at equal times at all speeds up to the fastest, 1."""
    mean, moment = (HUMP**k * gamma(k / SHARPNESS) / SHARPNESS for k in (1, 2))
    return float(4.0 * mean - 6.0 * moment), float(12.0 * moment - 6.0 * mean)


def _identified(tables: Sequence[Mapping[str, Any]], joint: int) -> _Friction:
    """Of a joint (from 1), the mean of what identifications state."""
    bands = [one for table in tables for one in table.get("friction_curves", ()) if one["joint"] == joint]
    if not bands:
        return _Friction(0.0, 0.0, np.nan)
    sizes = [friction_size(np.array(one["speed"]), np.array(one["torque"])) for one in bands]
    level, slope = np.mean(sizes, axis=0)
    return _Friction(float(level), float(slope), max(float(one["speed"][-1]) for one in bands))


def _of_model(arm: Arm | None, joint: int) -> _Friction:
    """Of a joint (from 1) of a model; nothing where there is none."""
    if arm is None or joint > len(arm):
        return _Friction(0.0, 0.0, np.nan)
    curve = arm.joints[joint - 1].friction_curve
    speed = np.linspace(0.0, 1.0, 3) if curve is None else np.array(curve.speed)
    level, slope = np.mean([friction_size(speed, of) for of in total_at(arm.joints[joint - 1], speed)], axis=0)
    return _Friction(float(level), float(slope), np.nan if curve is None else float(speed[-1]))


def _days(tables: Sequence[Mapping[str, Any]]) -> int:
    """On how many days the recordings of results were made, by their dates."""
    dates = [utc_date_of(one.get("recorded")) for one in tables]
    return len({date[:10] for date in dates if date is not None})
