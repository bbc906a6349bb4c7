"""Ripples of one joint whose orders are small multiples of one another have one origin, and are one cause.

The error of an encoder's sines, or of a wheel, is periodic but no pure sine: its second and third harmonic stand beside
it in the residual. They stay in the extended model, as terms of the strongest of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from arm_model.effects import CATALOGUE
from diagnosis.cause import Cause
from diagnosis.selection.next_order import are_multiples

WEAKER = 0.5
"""Most that a harmonic that is another effect explains, as a share of what the ripple explains."""


def with_harmonics(causes: Sequence[Cause]) -> list[Cause]:
    """The causes (strongest first), each ripple with its harmonics at the same joint in it."""
    kept: list[Cause] = []
    for cause in causes:
        ripple = next((k for k, one in enumerate(kept) if _is_harmonic(cause, one)), None)
        if ripple is None:
            kept.append(cause)
            continue
        multiple = _order(cause) / _order(kept[ripple])
        which = f"harmonic {multiple:.0f}" if multiple > 1.0 else f"subharmonic 1/{1 / multiple:.0f}"
        size = next(p for p in cause.parameters if CATALOGUE[cause.effect][p.name].linear)
        found = f"with its {which} ({size.value:.3g} {size.unit}, as {cause.effect.replace('_', ' ')})"
        sentence = f"{kept[ripple].evidence}; {found}"
        terms = (*kept[ripple].harmonics, *cause.terms)
        kept[ripple] = replace(
            kept[ripple], harmonics=terms, after=min(kept[ripple].after, cause.after), evidence=sentence
        )
    return kept


def _is_harmonic(cause: Cause, ripple: Cause) -> bool:
    """Whether a cause is a ripple at the joint of another one, with a multiple of its order or a fraction.

    The same effect; or another one that is weaker.
    """
    if cause.joint != ripple.joint or not are_multiples(_order(cause), _order(ripple)):
        return False
    explained, by_ripple = (one.before**2 - one.after**2 for one in (cause, ripple))
    return cause.effect == ripple.effect or explained < WEAKER * by_ripple


def _order(cause: Cause) -> float:
    """Cycles per turn of the motor; 0 where a cause is no ripple."""
    effect = CATALOGUE[cause.effect]
    return effect.cycles({p.name: p.value for p in cause.parameters}) if effect.wave else 0.0
