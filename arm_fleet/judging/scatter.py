"""Scatter of causes that replace one another from night to night.

If the friction of a healthy arm follows its temperature, diagnoses name viscous friction in one night, in the next
another cause with nearly the same current, and no cause in a third. A cause that no reference night names has no
scatter between them; yet it scatters like the friction of its joint, in units of their standard deviations: the
identified friction and the other causes of that kind. This scatter counts if chance does not explain it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy import stats

from arm_model.effects import CATALOGUE, Instrument, Variable
from comparison import Change, Quantity

CHANCE = 0.01
"""The scatter counts if the p-value of the hypothesis that the standard deviations explain it is below this."""
ALIKE = (Variable.VELOCITY, Variable.CURRENT)
"""Variables of the current residual of effects that can be confused with friction."""


def widened(changes: Sequence[Change], reference: int) -> list[Change]:
    """The same changes, with p-values of causes like friction that include the scatter between reference nights.

    changes    of one night, of identified parameters and of causes; reference: number of reference nights
    """
    freedom = reference - 1
    least = float(np.sqrt(stats.chi2.isf(CHANCE, freedom) / freedom))
    scatter: dict[int | None, float] = {}
    for one in changes:
        if one.scatter is not None and one.scatter > least and of_friction(one):
            joint = one.quantity.joint
            scatter[joint] = max(scatter.get(joint, 0.0), one.scatter)
    return [_with(change, scatter, freedom) for change in changes]


def _with(one: Change, scatter: dict[int | None, float], freedom: int) -> Change:
    if one.quantity.kind != "cause" or not of_friction(one) or one.p is None or not (one.change and one.std):
        return one
    joint = one.quantity.joint
    factor = max((value for its, value in scatter.items() if joint is None or its in (joint, None)), default=0.0)
    if not factor:
        return one
    p = float(2 * stats.t.sf(abs(one.change) / (factor * one.std), freedom))
    return replace(one, p=max(p, one.p))


def of_friction(one: Change) -> bool:
    """Whether the changed quantity is friction, or a cause that can be confused with friction."""
    return friction_like(one.quantity)


def friction_like(quantity: Quantity) -> bool:
    """Whether a quantity is friction, or a parameter of a cause that can be confused with friction."""
    kind = quantity.kind
    return like_friction(effect_of(quantity.name)) if kind == "cause" else kind in ("friction", "curve")


def effect_of(quantity: str) -> str:
    """'joint1.backlash.half_gap' -> 'backlash'."""
    return quantity.rpartition(".")[0].rpartition(".")[2]


@cache
def like_friction(effect: str) -> bool:
    """Whether this effect and friction can be confused in a current."""
    definition = CATALOGUE.get(effect)
    if definition is None:
        return False
    others = [CATALOGUE[name] for name in definition.confused_with if name in CATALOGUE]
    shows = definition.observed_by.get(Instrument.CURRENT)
    confused = any(_against(other.name) is Variable.VELOCITY for other in others)
    return shows is not None and (shows.against in ALIKE or (shows.against is Variable.ACCELERATION and confused))


def _against(effect: str) -> Variable | None:
    shows = CATALOGUE[effect].observed_by.get(Instrument.CURRENT)
    return None if shows is None else shows.against
