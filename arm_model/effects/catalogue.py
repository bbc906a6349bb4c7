"""Every effect of the vocabulary by its name."""

from __future__ import annotations

from arm_model.effects import (
    conditional_friction,
    description_errors,
    friction,
    position,
    sensing,
    tracking,
    transmission,
    water,
    wrist,
)
from arm_model.effects.definition import Effect, Values
from arm_model.effects.observation import Instrument

CATALOGUE: dict[str, Effect] = {
    effect.name: effect
    for family in (
        friction,
        conditional_friction,
        water,
        position,
        transmission,
        description_errors,
        wrist,
        sensing,
        tracking,
    )
    for effect in family.EFFECTS
}


def observed_by(instrument: Instrument) -> tuple[Effect, ...]:
    """The effects that an instrument shows."""
    return tuple(effect for effect in CATALOGUE.values() if instrument in effect.observed_by)


def friction_near_rest() -> tuple[Effect, ...]:
    """The effects that are friction where a joint turns or creeps."""
    return tuple(effect for effect in CATALOGUE.values() if effect.near_rest)


def same_columns(effect: Effect) -> tuple[str, ...]:
    """Effects that name ``effect`` as their alias and are named by it.

    In any recording their columns are the same, and both together could explain anything.
    """
    return tuple(name for name in effect.aliases if effect.name in CATALOGUE[name].aliases)


def values_of(effect: Effect, given: dict[str, float]) -> Values:
    """Parameter values for a law: ``given``, each name checked, the rest 0; ValueError names the unknown one."""
    names = [parameter.name for parameter in effect.parameters]
    for name in given:
        if name not in names:
            raise ValueError(f"{effect.name} has no parameter {name!r}; it has {', '.join(names)}")
    return Values({name: float(given.get(name, 0.0)) for name in names})
