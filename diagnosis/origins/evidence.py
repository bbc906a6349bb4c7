"""What the named causes say at one place: at a joint, or of the arm and its rig as a whole.

A cause is a finding with its ambiguity group, its confidence and qualifiers: the order of a wave against the teeth of
the gear, the sign of a size, whether other joints show the same, whether recordings contradict each other. What was
searched for and not found is evidence as well; what the recordings could not show is not.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import accumulate
from operator import mul

from arm_model import Arm, Joint
from arm_model.effects import CATALOGUE, Instrument
from diagnosis.cause import Cause, EffectKey

CLEAR = 2.0
"""Standard deviations that a size must exceed for its sign to count."""
SHARE = 0.5
"""Of an arm's joints that must show an effect for it to be one of several."""
SAME_ORDER = 0.01
"""Relative difference within which two orders are the same."""
TOOTHED = 3
"""Least order that may be one of teeth, where the model does not say how many there are."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One cause, as evidence at a place (a joint, or the arm).

    effects    of its ambiguity group that are at this place, the named one first if it is
    elsewhere  members of the group at another place
    holds, fails  qualifiers of the named effect that are true and untrue; others are not known
    """

    effects: tuple[str, ...]
    elsewhere: int
    confidence: float
    holds: frozenset[str] = frozenset()
    fails: frozenset[str] = frozenset()

    @property
    def effect(self) -> str:
        """The named effect, or the first of its group that is here."""
        return self.effects[0]


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """All that is known at a joint (from 1); None: of the arm and its rig.

    absent  effects that would have been found here, and were not
    """

    joint: int | None
    findings: tuple[Finding, ...]
    absent: frozenset[str]


def evidence_of(
    causes: Sequence[Cause],
    arm: Arm,
    instruments: Collection[Instrument],
    undetectable: Set[EffectKey] = frozenset(),
) -> list[Evidence]:
    """Evidence at every place where a cause is named: the arm first, then its joints.

    ``instruments`` that searched; ``undetectable``: effects that these recordings could not show.
    """
    joints = sorted({cause.joint for cause in causes if cause.joint is not None})
    places = [None, *joints]
    shown = _several(causes, len(arm))
    found = [
        _at(place, causes, arm, shown, frozenset(_searched(place, len(arm), instruments, undetectable)))
        for place in places
    ]
    return [one for one in found if one.findings]


def _at(
    place: int | None, causes: Sequence[Cause], arm: Arm, several: Mapping[str, bool], searched: frozenset[str]
) -> Evidence:
    findings = [_finding(cause, arm, several) for cause in causes if cause.joint == place]
    if place is None:
        # one cause that several joints show together (a hum of the rig) is a finding of the arm already
        of_joints = {cause.effect for cause in causes if cause.joint is not None}
        alike = [name for name, yes in several.items() if yes and name in of_joints and CATALOGUE[name].per_joint]
        findings += [_shared(name, causes, arm) for name in alike]
        findings += [of_arm for cause in causes if (of_arm := _of_arm(cause)) is not None]
    effects = {effect for one in findings for effect in one.effects}
    effects |= {effect for cause in causes for effect, joint in cause.group if joint == place}
    return Evidence(joint=place, findings=tuple(findings), absent=searched - effects)


def _finding(cause: Cause, arm: Arm, several: Mapping[str, bool]) -> Finding:
    others = [effect for effect, joint in cause.group if joint == cause.joint and effect != cause.effect]
    known = dict(_qualifiers(cause, arm))
    if cause.effect in several and len(arm) > 1:
        known["several"] = several[cause.effect]
    return Finding(
        effects=(cause.effect, *others),
        elsewhere=sum(joint != cause.joint for _, joint in cause.group),
        confidence=cause.confidence,
        holds=frozenset(name for name, yes in known.items() if yes),
        fails=frozenset(name for name, yes in known.items() if not yes),
    )


def _of_arm(cause: Cause) -> Finding | None:
    """A cause of one joint read as the same effect of the whole arm, if it may be that; else None.

    Its sizes are left out: they are those of the joint's effect.
    """
    effects = tuple(effect for effect, joint in cause.group if joint is None)
    if cause.joint is None or not effects:
        return None
    return Finding(effects=effects, elsewhere=len(cause.group) - len(effects), confidence=cause.confidence)


def _shared(effect: str, causes: Sequence[Cause], arm: Arm) -> Finding:
    """An effect that several joints have as one finding of the arm, with what they have in common."""
    at_joints = [cause for cause in causes if cause.effect == effect and cause.joint is not None]
    known = [dict(_qualifiers(cause, arm)) for cause in at_joints]
    names = set.intersection(*(set(one) for one in known))
    return Finding(
        effects=(effect,),
        elsewhere=0,
        confidence=min(cause.confidence for cause in at_joints),
        holds=frozenset(name for name in names if all(one[name] for one in known)) | {"several"},
        fails=frozenset(name for name in names if not any(one[name] for one in known)),
    )


def _several(causes: Sequence[Cause], joints: int) -> dict[str, bool]:
    """Named effect -> whether half of the joints or more show it, and no fewer than two."""
    places: dict[str, set[int]] = {}
    for cause in causes:
        places.setdefault(cause.effect, set()).update([cause.joint] if cause.joint else cause.of_joints)
    return {effect: len(found_at) >= max(2, SHARE * joints) for effect, found_at in places.items() if found_at}


def _searched(
    place: int | None, joints: int, instruments: Collection[Instrument], undetectable: Set[EffectKey]
) -> Iterator[str]:
    """Effects that the recordings would have shown at a place."""
    for name, effect in CATALOGUE.items():
        at: Sequence[int | None] = [place] if place or not effect.per_joint else range(1, joints + 1)
        visible = not any((name, joint) in undetectable for joint in at)
        if visible and not set(instruments).isdisjoint(effect.observed_by):
            yield name


def _qualifiers(cause: Cause, arm: Arm) -> Iterator[tuple[str, bool]]:
    """Qualifiers of a cause (name -> whether it holds) beyond its effect."""
    effect, values = CATALOGUE[cause.effect], {p.name: p for p in cause.parameters}
    yield "changed", bool(cause.of_recordings)
    if not effect.per_joint:
        yield "one_channel", len(cause.of_joints) == 1
    size = next((values[p.name] for p in effect.linear if p.signed and p.name in values), None)
    if size is not None and abs(size.value) > CLEAR * size.std:
        yield "more", size.value > 0.0
        yield "less", size.value < 0.0
    cycles = effect.cycles({name: p.value for name, p in values.items()})
    if cycles and cause.joint is not None:
        joint = arm.joints[cause.joint - 1]
        turns, teeth = _orders(cycles, joint), _tooth_orders(joint)
        yield "first_order", 1 in turns
        yield "second_order", 2 in turns
        of_known_teeth = any(abs(cycles - order) < SAME_ORDER * order for order in teeth)
        yield "tooth_order", of_known_teeth if teeth else max(turns, default=0) >= TOOTHED


def _orders(cycles: float, joint: Joint) -> list[int]:
    """Whole cycles per turn of the first shaft that has some, from the motor to the joint; ``cycles``: of the motor."""
    for ratio in (1.0, *_shafts(joint), abs(joint.ratio)):
        order = cycles * ratio
        if round(order) > 0 and abs(order - round(order)) < SAME_ORDER * order:
            return [round(order)]
    return []


def _tooth_orders(joint: Joint) -> list[float]:
    """Engagements of the teeth of every gear stage per turn of the motor, where the model has them."""
    return [stage.teeth / ratio for stage, ratio in zip(joint.gear_stage, _shafts(joint)) if stage.teeth]


def _shafts(joint: Joint) -> list[float]:
    """Turns of the motor per turn of the shaft behind each gear stage."""
    return list(accumulate((stage.ratio for stage in joint.gear_stage), mul))
