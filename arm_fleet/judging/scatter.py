"""Causes that take each other's place from night to night.

Where friction of a healthy arm follows its temperature, diagnoses name it in one night viscous friction, in the next
another cause with nearly the same current, and none in a third. A cause that no reference night names has no scatter
of its own between them; yet it scatters as friction of its joint does, in units of their deviations: as identified, and
as other causes of that kind say. That counts where it is more than chance explains.
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
"""p-value, of deviations that explain all scatter, below which it counts."""
ALIKE = (Variable.VELOCITY, Variable.CURRENT)
"""Against what the current shows effects that friction may be taken for."""


def widened(changes: Sequence[Change], reference: int) -> list[Change]:
    """The same changes; p-values of causes like friction allow for the scatter between reference nights.

    changes    of one night, of identified parameters and of causes; reference: number of nights it is compared with
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
    """Whether what changed is friction, or a cause that friction may be taken for."""
    return friction_like(one.quantity)


def friction_like(quantity: Quantity) -> bool:
    """Likewise, of a quantity."""
    kind = quantity.kind
    return like_friction(effect_of(quantity.name)) if kind == "cause" else kind in ("friction", "curve")


def effect_of(quantity: str) -> str:
    """'joint1.backlash.half_gap' -> 'backlash'."""
    return quantity.rpartition(".")[0].rpartition(".")[2]


@cache
def like_friction(effect: str) -> bool:
    """Whether what friction changes in a current may be taken for this effect, or the other way round."""
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
