"""What belongs to an effect that is chosen: next-order terms of its law, and further orders of a ripple.

An effect that was chosen and leaves what a term of its own law explains is that effect with the term, not two effects.
A term is a candidate once its effect is chosen. It has a column of its own, and refers to the phase or the rest
position that its effect has by then. A ripple is periodic, and seldom a pure sine: the same effect at a small multiple
of its order is its harmonic. A wheel whose teeth differ over its turn, or that sits eccentrically, makes side bands:
the same effect at an order that is a turn or two of a slower shaft away. Another wheel, or a second error of the same
one, makes a ripple of an order of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Pair
from diagnosis.selection.ripple_orders import side_band

HIGHEST = 3
"""Multiples that belong to a ripple; higher ones have origins of their own (a motor's poles, the teeth of a wheel)."""
SAME = 0.01
"""Relative difference of two orders that are multiples."""
SAME_ORDER = 1e-6
"""Relative difference below which two orders are the same: their rounding."""


def next_orders(chosen: Candidate, coefficients: Array, seconds: float) -> Iterator[Candidate]:
    """The chosen candidate, of coefficients (k,), with each of the terms that it does not have yet.

    seconds: length of the longest recording, after which a term of time stays as it is.
    """
    effect, values = chosen.definition, chosen.parameters(coefficients.tolist())
    shape = dict(chosen.shape)
    if effect.span is not None and effect.terms:
        shape[effect.span.name] = values[effect.span.name]
    for term in effect.terms:
        if term not in chosen.terms:
            lasts = effect.lasting(term)
            until = () if lasts is None else ((lasts.name, seconds),)
            yield replace(chosen, shape=(*shape.items(), *until), terms=(*chosen.terms, term))


def of_last_term(pair: Pair) -> Pair:
    """The column of a candidate's last term, of all its columns."""
    return pair.map(lambda columns: Columns(columns.x[:, -1:], columns.where))


def small_term(candidate: Candidate, parts: Array, limit: float) -> bool:
    """Whether the last term contributes at most ``limit`` times what the law itself does (rms), by parts (N, k).

    A term of time has no natural origin: the part of it that is like the law is counted to the law.
    """
    law, term = parts[:, :-1].sum(axis=1), parts[:, -1]
    if candidate.definition.lasting(candidate.terms[-1]) is not None:
        common = float(law @ term / max(float(law @ law), 1e-300)) * law
        law, term = law + common, term - common
    return bool(np.sum(term**2) <= limit**2 * np.sum(law**2))


def term_share(candidate: Candidate) -> float:
    """Largest share of what the candidate explains that its last term may explain."""
    return candidate.definition.of_term(candidate.terms[-1]).term_share


def further_orders(chosen: Sequence[Candidate], library: Iterable[Candidate]) -> Iterator[Candidate]:
    """Candidates that are ripples of another order than those chosen of the same effect and joint."""
    for c in library:
        if is_further_order(c, chosen):
            yield c


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
