"""Conversion between an effect's parameters, which a model has, and coefficients of columns, which are fitted.

``units`` are the parameter values at which the law is evaluated for a column each; ``solved`` turns the coefficients of
these columns back into parameters. What lies between is said by ``Parameter.linear`` and ``Parameter.span``: the law at
``solved(effect, held, c)`` is the sum of c_k times the law at ``units(effect, held)[k]``.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from arm_model.effects.definition import Effect, Values
from arm_model.effects.observation import Span


def units(effect: Effect, held: Mapping[str, float], amplitude: str = "", terms: Sequence[str] = ()) -> list[Values]:
    """Parameter values, one set per column: each of ``Effect.sizes`` at 1 in turn, a spanned one at each of its values.

    ``held``: all others. ``terms``: next-order terms of the law, whose columns come last; they refer to the spanned
    value in ``held``. What is not given of terms, and of the joint's own, is 0.
    """
    held = {p.name: 0.0 for p in effect.parameters if p.term or p.own} | dict(held)
    spanned = [(p.name, p.span.values) for p in effect.nonlinear if p.span is not None and p.span.values]
    sets = []
    for values in itertools.product(*(values for _, values in spanned)):
        for one in effect.sizes(amplitude) or (None,):
            chosen = (
                {p.name: 0.0 for p in effect.linear} | dict(held) | dict(zip((name for name, _ in spanned), values))
            )
            if one is not None:
                chosen[one.name] = 1.0
            sets.append(Values(chosen))
    still = {p.name: 0.0 for p in effect.linear} | held
    return sets + [Values(still | {effect.of_term(term).name: 1.0}) for term in terms]


def solved(
    effect: Effect,
    held: Mapping[str, float],
    coefficients: Sequence[float],
    amplitude: str = "",
    terms: Sequence[str] = (),
) -> dict[str, float]:
    """Parameter values (SI) that the coefficients (k,) of the columns at ``units`` stand for.

    ``held``: of parameters that are no coefficient. ``terms``: next-order terms whose coefficients come last.
    """
    every = [float(value) for value in coefficients]
    law = len(every) - len(terms)
    of_terms = {effect.of_term(term).name: value for term, value in zip(terms, every[law:])}
    return _of_law(effect, held, every[:law], amplitude) | of_terms


def _of_law(effect: Effect, held: Mapping[str, float], c: Sequence[float], amplitude: str) -> dict[str, float]:
    if effect.delay is not None:
        return {effect.parameters[0].name: c[0]}
    linear = effect.sizes(amplitude)
    found = {**held, **{p.name: value for p, value in zip(linear, c)}}
    if (spanned := effect.span) is not None and spanned.span is not None:
        found[linear[0].name], found[spanned.name] = spanned.span.solve(*c)
    moments = [p for p in effect.parameters if p.span is Span.MOMENT]
    first = c[len(linear) :][: len(moments)]
    found |= {p.name: value / c[0] if c[0] else 0.0 for p, value in zip(moments, first)}
    about_origin = c[len(linear) + len(moments) :]
    if moments and about_origin:
        names = [p.name for p in effect.parameters if p.span is Span.INERTIA]
        found |= dict(zip(names, _about_centre(c[0], first, about_origin)))
    return found


def _about_centre(mass: float, first: Sequence[float], about_origin: Sequence[float]) -> list[float]:
    """(6,) kg m2 xx, xy, xz, yy, yz, zz about the centre of mass, from those about the frame's origin.

    mass kg, first moment (3,) kg m.
    """
    x, y, z = first
    square = x * x + y * y + z * z
    steiner = (square - x * x, -x * y, -x * z, square - y * y, -y * z, square - z * z)
    return [value - (other / mass if mass else 0.0) for value, other in zip(about_origin, steiner)]
