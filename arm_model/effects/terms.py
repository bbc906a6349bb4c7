"""Effect terms of an arm (``[[effect]]`` in its model file): checks, and those that change the description applied."""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from pydantic import ValidationError

from arm_io import InputError
from arm_io.toml import one_line
from arm_model.description import Arm, Coupling, EffectTerm
from arm_model.effects import dissipation
from arm_model.effects.catalogue import CATALOGUE, values_of
from arm_model.effects.definition import Effect, Parameter

DERIVED = frozenset({"contact_stiffness", "contact_damping"})
"""Parameters that follow from the joint where they are not given (``arm_model.system.step_size``)."""


def check_terms(arm: Arm, where: str | Path | None = None, *, sizes: bool = False) -> None:
    """InputError (one line) where an effect term of the arm names no effect, or its joint or parameters do not fit.

    ``where`` is named in it, by default the arm. ``sizes``: also where a size is negative that no arm has so, or
    friction drives a joint; an arm that says why (``unphysical``) may have both.
    """
    where = arm.name if where is None else where
    for number, term in enumerate(arm.effects, 1):
        here = f"effect[{number}]"
        effect = CATALOGUE.get(term.name)
        if effect is None:
            near = get_close_matches(term.name, CATALOGUE, 1)
            known = f"is it {near[0]}?" if near else f"expected one of {', '.join(CATALOGUE)}"
            raise InputError(where, f"{here}.name: no effect {term.name!r}; {known}")
        if not effect.per_joint and term.joint is not None:
            raise InputError(where, f"{here}.joint: {term.name} belongs to the whole arm; leave 'joint' out")
        if effect.per_joint and not (term.joint and term.joint <= len(arm)):
            raise InputError(where, f"{here}.joint: {term.name} needs a joint in 1..{len(arm)} (is {term.joint})")
        if effect.cylinder and term.joint and arm.joints[term.joint - 1].cylinder is None:
            raise InputError(
                where,
                f"{here}: {term.name} needs joint[{term.joint}].cylinder (start, end, radius), the body in the water",
            )
        _check_parameters(effect, term, where, here)
    if sizes and not arm.unphysical and (problem := negative_size(arm) or dissipation.problem(arm)):
        raise InputError(where, problem)


def _check_parameters(effect: Effect, term: EffectTerm, where: str | Path, here: str) -> None:
    known = [parameter.name for parameter in effect.parameters]
    for name in term.parameters:
        if name not in known:
            raise InputError(where, f"{here}.parameters.{name}: {effect.name} has {', '.join(known)}")
    if effect.linear and not any(parameter.name in term.parameters for parameter in effect.linear):
        first = effect.linear[0]
        raise InputError(where, f"{here}.parameters.{first.name}: is missing ({first.unit}; {first.meaning})")
    for parameter in effect.parameters:
        value = term.parameters.get(parameter.name)
        place = f"{here}.parameters.{parameter.name}"
        if _must_be_positive(parameter) and value is None:
            raise InputError(where, f"{place}: is missing ({parameter.unit}; {parameter.meaning})")
        if _must_be_positive(parameter) and value is not None and value <= 0:
            raise InputError(where, f"{place}: must be positive (is {value:g} {parameter.unit})")


def negative_size(arm: Arm) -> str:
    """The first value below 0 that no arm has, such as a gap, in words; "" where there is none.

    Friction is left to ``dissipation``: a hump may be negative if the total opposes the motion.
    """
    for number, term in enumerate(arm.effects, 1):
        effect = CATALOGUE[term.name]
        of_arm = not effect.friction and any(seen.of_arm for seen in effect.observed_by.values())
        for name, value in term.parameters.items():
            if of_arm and value < 0.0 and not effect[name].signed:
                return f"effect[{number}].parameters.{name}: must not be negative (is {value:g} {effect[name].unit})"
    return ""


def _must_be_positive(parameter: Parameter) -> bool:
    """Laws divide by it, or mean nothing at 0; linear ones are 0 where they are not given."""
    return not (parameter.linear or parameter.signed or parameter.name in DERIVED) and parameter.typical[0] > 0


def described(arm: Arm) -> Arm:
    """The arm with those effects put into its description that are just other numbers in it.

    Such as a payload or a tilted base. InputError where an effect makes a number that no arm has: a negative mass.
    """
    bent = arm
    for number, term in enumerate(arm.effects, 1):
        effect = CATALOGUE[term.name]
        if effect.change is None:
            continue
        try:
            bent = effect.change(bent, term.joint, values_of(effect, term.parameters))
        except ValidationError as error:
            where = f"joint {term.joint}" if term.joint else "the arm"
            raise InputError(
                arm.name, f"effect[{number}]: {term.name} makes {where} impossible: {one_line(error)}"
            ) from None
    return bent


def coupled(arm: Arm) -> Arm:
    """The arm with the turns of axes by other motors that its effects make, as entries of its coupling matrix."""
    entries = {(entry.joint, entry.by): entry.ratio for entry in arm.coupling}
    for term in arm.effects:
        for name, value in term.parameters.items() if CATALOGUE[term.name].coupling else ():
            place = int(name[1]), int(name[2])  # cij
            if max(place) <= len(arm) and value != 0.0:
                entries[place] = entries.get(place, 0.0) + value
    if len(entries) == len(arm.coupling) and all(entries[e.joint, e.by] == e.ratio for e in arm.coupling):
        return arm
    return replace(arm, coupling=tuple(Coupling(*place, ratio) for place, ratio in entries.items()))
