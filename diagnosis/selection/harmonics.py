"""Ripples of one joint that are harmonics or side bands of one another, or of one effect, are one cause.

The error of an encoder's sines, or of a wheel, is periodic but no pure sine: its second and third harmonic stand beside
it in the residual. A wheel whose teeth differ over its turn, or that sits eccentrically, makes side bands: the same
effect at an order that is a turn or two of a slower shaft away. Another wheel, or a second error of the same one, makes
a ripple of an order of its own. All are candidates beside the chosen ripple, and stay in the extended model as terms of
the strongest of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from arm_model import Arm
from arm_model.effects import CATALOGUE
from diagnosis.cause import Cause
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.ripple_orders import cycles_in_words, shaft_in_words, side_band

WEAKER = 0.5
"""Most that a harmonic that is another effect explains, as a share of what the ripple explains."""
HIGHEST = 3
"""Multiples that belong to a ripple; higher ones have origins of their own (a motor's poles, the teeth of a wheel)."""
SAME = 0.01
"""Relative difference of two orders that are multiples."""
SAME_ORDER = 1e-6
"""Relative difference below which two orders are the same: their rounding."""


def is_further_order(candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
    """Whether a candidate is a ripple of which other orders are chosen, and not its own."""
    same_key = [c for c in chosen if c.key == candidate.key]
    if not (same_key and candidate.definition.wave):
        return False
    order = _order(candidate)
    return all(abs(_order(c) - order) > SAME_ORDER * order for c in same_key)


def is_of_ripple(candidate: Candidate, chosen: Sequence[Candidate], arm: Arm) -> bool:
    """Whether a candidate is a ripple of which another order is chosen: its harmonic, or a side band of it."""
    return any(_of_one_ripple(candidate, c, arm) for c in chosen)


def _of_one_ripple(candidate: Candidate, ripple: Candidate, arm: Arm) -> bool:
    if candidate.key != ripple.key or candidate.amplitude != ripple.amplitude or not candidate.definition.wave:
        return False
    order, carrier = _order(candidate), _order(ripple)
    return (
        are_multiples(order, carrier) or side_band(order, carrier, arm.joints[(candidate.joint or 1) - 1]) is not None
    )


def _order(ripple: Candidate) -> float:
    """Cycles per turn of the motor."""
    return ripple.definition.cycles(dict(ripple.shape))


def are_multiples(order: float, other: float) -> bool:
    """Whether one of two orders is twice or three times the other."""
    if not (order and other):
        return False
    multiple = max(order / other, other / order)
    return 2 <= round(multiple) <= HIGHEST and abs(multiple / round(multiple) - 1.0) < SAME


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
    if cause.joint != ripple.joint or cause.joint is None or not (_order_of_cause(cause) and _order_of_cause(ripple)):
        return ""
    explained, by_ripple = (one.before**2 - one.after**2 for one in (cause, ripple))
    if are_multiples(_order_of_cause(cause), _order_of_cause(ripple)):
        if cause.effect != ripple.effect and explained >= WEAKER * by_ripple:
            return ""
        multiple = _order_of_cause(cause) / _order_of_cause(ripple)
        return f"harmonic {multiple:.0f}" if multiple > 1.0 else f"subharmonic 1/{1 / multiple:.0f}"
    if cause.effect != ripple.effect:
        return ""
    joint = arm.joints[cause.joint - 1]
    if (band := side_band(_order_of_cause(cause), _order_of_cause(ripple), joint)) is not None:
        return f"side band {band[0]:+d} per turn of {shaft_in_words(band[1], joint)}"
    return f"further order, {cycles_in_words(_order_of_cause(cause), joint)}"


def _order_of_cause(cause: Cause) -> float:
    """Cycles per turn of the motor; 0 where a cause is no ripple."""
    effect = CATALOGUE[cause.effect]
    return effect.cycles({p.name: p.value for p in cause.parameters}) if effect.wave else 0.0
