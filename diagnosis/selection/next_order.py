"""What belongs to an effect that is chosen: next-order terms of its law, and harmonics of a ripple.

An effect that was chosen and leaves what a term of its own law explains is that effect with the term, not two effects.
A term is a candidate once its effect is chosen. It has a column of its own, and refers to the phase or the rest
position that its effect has by then. A ripple is periodic, and seldom a pure sine: the same effect at a small multiple
of its order is its harmonic.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Pair

HIGHEST = 3
"""Multiples that belong to a ripple; higher ones have origins of their own (a motor's poles, the teeth of a wheel)."""
SAME = 0.01
"""Relative difference of two orders that are multiples."""


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


def of_last_term(own: Pair) -> Pair:
    """The column of a candidate's last term, of all its columns."""
    return own.map(lambda columns: Columns(columns.x[:, -1:], columns.where))


def small_term(candidate: Candidate, parts: Array, most: float) -> bool:
    """Whether what the last term does is at most ``most`` times what the law does (rms), of parts (N, k).

    Time begins anywhere: what of a term of time is like the law belongs to the law.
    """
    law, term = parts[:, :-1].sum(axis=1), parts[:, -1]
    if candidate.definition.lasting(candidate.terms[-1]) is not None:
        common = float(law @ term / max(float(law @ law), 1e-300)) * law
        law, term = law + common, term - common
    return bool(np.sum(term**2) <= most**2 * np.sum(law**2))


def term_share(candidate: Candidate) -> float:
    """Largest share of what the candidate explains that its last term may explain."""
    return candidate.definition.of_term(candidate.terms[-1]).term_share


def harmonics(chosen: Sequence[Candidate], library: Iterable[Candidate]) -> Iterator[Candidate]:
    """Candidates that are a chosen ripple at a multiple of its order, or at a fraction, and are not chosen yet."""
    for c in library:
        if c not in chosen and is_harmonic(c, chosen):
            yield c


def is_harmonic(candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
    """Whether a candidate is a ripple of which another order is chosen: the harmonic of that."""
    return any(_is_harmonic(candidate, one) for one in chosen)


def _is_harmonic(candidate: Candidate, ripple: Candidate) -> bool:
    if candidate.key != ripple.key or candidate.amplitude != ripple.amplitude or not candidate.definition.wave:
        return False
    return are_multiples(*(c.definition.cycles(dict(c.shape)) for c in (candidate, ripple)))


def are_multiples(order: float, other: float) -> bool:
    """Whether one of two orders is twice or three times the other."""
    if not (order and other):
        return False
    multiple = max(order / other, other / order)
    return 2 <= round(multiple) <= HIGHEST and abs(multiple / round(multiple) - 1.0) < SAME
