"""Between an effect's parameters and the coefficients of its columns.

An estimator fits coefficients, a model has parameters.

``units`` are the parameter values at which the law is evaluated for a column each; ``solved`` turns the coefficients of
these columns back into parameters. What lies between is said by ``Parameter.linear`` and ``Parameter.span``: the law at
``solved(effect, held, c)`` is the sum of c_k times the law at ``units(effect, held)[k]``.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from arm_model.effects.definition import Effect, Values
from arm_model.effects.observation import Span


def units(effect: Effect, held: Mapping[str, float]) -> list[Values]:
    """Parameter values, one set per column: each linear parameter at 1 in turn, a spanned one at each of its values.

    ``held``: all others.
    """
    spanned = [(p.name, p.span.values) for p in effect.nonlinear if p.span is not None and p.span.values]
    sets = []
    for values in itertools.product(*(values for _, values in spanned)):
        for one in effect.linear or (None,):
            chosen = (
                {p.name: 0.0 for p in effect.linear} | dict(held) | dict(zip((name for name, _ in spanned), values))
            )
            if one is not None:
                chosen[one.name] = 1.0
            sets.append(Values(chosen))
    return sets


def solved(effect: Effect, held: Mapping[str, float], coefficients: Sequence[float]) -> dict[str, float]:
    """Parameter values (SI) that the coefficients (k,) of an effect's columns stand for.

    ``held``: of parameters that are no coefficient.
    """
    c = [float(value) for value in coefficients]
    if effect.delay is not None:
        return {effect.parameters[0].name: c[0]}
    found = {**held, **{p.name: value for p, value in zip(effect.linear, c)}}
    if (spanned := effect.span) is not None and spanned.span is not None:
        found[effect.linear[0].name], found[spanned.name] = spanned.span.solve(*c)
    moments = [p for p in effect.parameters if p.span is Span.MOMENT]
    found |= {p.name: value / c[0] if c[0] else 0.0 for p, value in zip(moments, c[len(effect.linear) :])}
    return found
