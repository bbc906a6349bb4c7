"""Sizes of friction as shares of the friction that the model of a joint has: a level grown by 47 %."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from arm_model import Joint
from arm_model.effects import CATALOGUE
from diagnosis.cause import Estimate


def with_shares(effect: str, values: Sequence[Estimate], joint: Joint) -> list[Estimate]:
    """The parameters of an effect, levels and slopes of friction with their share of the joint's own.

    A level is held against Coulomb friction of the same direction (both: their mean), a slope against viscous friction,
    a hump against Coulomb friction and friction curve at the velocity where it has fallen to 1/e.
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
    level = [joint.ratio * value for value in joint.coulomb]
    slope = [joint.ratio**2 * value for value in joint.viscous]
    curve = joint.friction_curve
    bent = 0.0 if curve is None else float(np.interp(speed, curve.speed, np.add(curve.positive, curve.negative) / 2))
    return {
        "coulomb": sum(level) / 2,
        "positive": level[0],
        "negative": level[1],
        "viscous": sum(slope) / 2,
        "viscous_positive": slope[0],
        "viscous_negative": slope[1],
        "breakaway": sum(level) / 2 + bent,
    }
