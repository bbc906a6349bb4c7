"""Sizes of friction as shares of the friction that the model of a joint has: a level grown by 47 %."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from arm_model import Joint
from arm_model.effects import CATALOGUE
from diagnosis.cause import Estimate

SPEEDS = 200
"""Points of a friction curve, evenly over its speeds, by which its straight part goes."""


def with_shares(effect: str, values: Sequence[Estimate], joint: Joint) -> list[Estimate]:
    """The parameters of an effect, levels and slopes of friction with their share of the joint's own.

    A level is held against Coulomb friction of the same direction (both: their mean), a slope against viscous friction;
    of a friction curve, against its straight part. A hump is held against Coulomb friction and friction curve at the
    velocity where it has fallen to 1/e.
    """
    if not CATALOGUE[effect].friction:
        return list(values)
    own = own_friction(joint, next((p.value for p in values if p.name == "stribeck_velocity"), 0.0))
    return [
        replace(p, of_own=p.value / own[p.name]) if own.get(p.name, 0.0) > 0.0 and np.isfinite(p.value) else p
        for p in values
    ]


def own_friction(joint: Joint, speed: float) -> Mapping[str, float]:
    """N m (N) and N m s/rad (N s/m) of a joint's own friction, by the parameter that is held against it."""
    curve = joint.friction_curve
    (up, up_slope), (down, down_slope) = (straight_part(joint, direction) for direction in (0, 1))
    bent = 0.0 if curve is None else float(np.interp(speed, curve.speed, np.add(curve.positive, curve.negative) / 2))
    return {
        "coulomb": (up + down) / 2,
        "positive": up,
        "negative": down,
        "viscous": (up_slope + down_slope) / 2,
        "viscous_positive": up_slope,
        "viscous_negative": down_slope,
        "breakaway": joint.ratio * sum(joint.coulomb) / 2 + bent,
    }


def straight_part(joint: Joint, direction: int) -> tuple[float, float]:
    """Level, N m (N), and slope, N m s/rad (N s/m), of a joint's own friction moving positive (0) or negative (1).

    Of a friction curve, those of the nearest straight line over its speeds: how a curve is divided into Coulomb
    friction, viscous friction and the rest is the choice of who identified it.
    """
    level, slope = joint.ratio * joint.coulomb[direction], joint.ratio**2 * joint.viscous[direction]
    curve = joint.friction_curve
    if curve is None:
        return level, slope
    speed = np.linspace(min(curve.speed), max(curve.speed), SPEEDS)
    friction = np.interp(speed, curve.speed, (curve.positive, curve.negative)[direction])
    curve_slope, curve_level = np.polyfit(speed, friction, 1)
    return level + float(curve_level), slope + float(curve_slope)
