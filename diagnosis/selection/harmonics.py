"""Ripples of one joint that are harmonics or side bands of one another, or of one effect, are one cause.

The error of an encoder's sines, or of a wheel, is periodic but no pure sine: its second and third harmonic stand beside
it in the residual; and teeth that differ over the turn of a wheel make side bands. A second wheel has an order of its
own. They stay in the extended model, as terms of the strongest of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from arm_model import Arm
from arm_model.effects import CATALOGUE
from diagnosis.cause import Cause
from diagnosis.selection.next_order import are_multiples
from diagnosis.selection.ripple_orders import cycles_in_words, shaft_in_words, side_band

WEAKER = 0.5
"""Most that a harmonic that is another effect explains, as a share of what the ripple explains."""


def with_harmonics(causes: Sequence[Cause], arm: Arm) -> list[Cause]:
    """The causes (strongest first), each ripple with the further orders at the same joint in it."""
    distinct: list[Cause] = []
    for cause in causes:
        relation = next(
            ((k, words) for k, other in enumerate(distinct) if (words := _relation(cause, other, arm))), None
        )
        if relation is None:
            distinct.append(cause)
            continue
        ripple, name = relation
        size = next(p for p in cause.parameters if CATALOGUE[cause.effect][p.name].linear)
        clause = f"with its {name} ({size.value:.3g} {size.unit}, as {cause.effect.replace('_', ' ')})"
        sentence = f"{distinct[ripple].evidence}; {clause}"
        terms = (*distinct[ripple].harmonics, *cause.terms)
        distinct[ripple] = replace(
            distinct[ripple], harmonics=terms, after=min(distinct[ripple].after, cause.after), evidence=sentence
        )
    return distinct


def _relation(cause: Cause, ripple: Cause, arm: Arm) -> str:
    """``harmonic 2``, or which side band or further order a cause is of a ripple at its joint; empty where it is none.

    A harmonic is the same effect, or another one that is weaker; a side band and a further order are the same effect.
    """
    if cause.joint != ripple.joint or cause.joint is None or not (_order(cause) and _order(ripple)):
        return ""
    explained, by_ripple = (one.before**2 - one.after**2 for one in (cause, ripple))
    if are_multiples(_order(cause), _order(ripple)):
        if cause.effect != ripple.effect and explained >= WEAKER * by_ripple:
            return ""
        multiple = _order(cause) / _order(ripple)
        return f"harmonic {multiple:.0f}" if multiple > 1.0 else f"subharmonic 1/{1 / multiple:.0f}"
    if cause.effect != ripple.effect:
        return ""
    joint = arm.joints[cause.joint - 1]
    if (band := side_band(_order(cause), _order(ripple), joint)) is not None:
        return f"side band {band[0]:+d} per turn of {shaft_in_words(band[1], joint)}"
    return f"further order, {cycles_in_words(_order(cause), joint)}"


def _order(cause: Cause) -> float:
    """Cycles per turn of the motor; 0 where a cause is no ripple."""
    effect = CATALOGUE[cause.effect]
    return effect.cycles({p.name: p.value for p in cause.parameters}) if effect.wave else 0.0
