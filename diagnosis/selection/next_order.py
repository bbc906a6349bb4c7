"""Next-order terms of the law of an effect that is chosen, such as the hardening of a spring.

An effect that was chosen and leaves what a term of its own law explains is that effect with the term, not two effects.
A term is a candidate once its effect is chosen. It has a column of its own, and refers to the phase or the rest
position that its effect has by then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from arm_io.types import Array
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Pair


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


def term_share(candidate: Candidate) -> float:
    """Largest share of what the candidate explains that its last term may explain."""
    return candidate.definition.of_term(candidate.terms[-1]).term_share
