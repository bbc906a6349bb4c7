"""An effect's columns, times any coefficients, are its law at the parameters that these coefficients stand for."""

from __future__ import annotations

import numpy as np
import pytest

from arm_model.effects import CATALOGUE, Effect, Signals, Span, solved, units, values_of


def _law(effect: Effect, amplitude: str = ""):
    """The law over signals that is linear in coefficients; of a wave with two amplitudes, that of one of them."""
    if effect.torque and effect.deflection:
        return effect.torque if amplitude else effect.deflection
    return effect.torque or effect.current or effect.angle or effect.bend or effect.late or effect.deflection


LINEAR = [(name, "") for name, effect in CATALOGUE.items() if effect.linear and _law(effect)]


TERMS = [(name, "", (term,)) for name, effect in CATALOGUE.items() for term in effect.terms]


@pytest.mark.parametrize(
    ("name", "amplitude", "terms"), [*((*one, ()) for one in [*LINEAR, ("gear_ripple", "torque")]), *TERMS]
)
def test_law_at_solved_parameters_is_the_sum_of_columns(name: str, amplitude: str, terms: tuple[str, ...]) -> None:
    """Of next-order terms as well, while the phase or rest angle that they refer to is the one that is solved."""
    effect, generator = CATALOGUE[name], np.random.default_rng(len(name))
    law, held = _law(effect, amplitude), {p.name: float(generator.uniform(*p.typical)) for p in effect.nonlinear}
    v, n = generator.normal(size=60), 60
    signals = Signals(
        q=generator.normal(size=n),
        v=v,
        motor=60 * generator.normal(size=n),
        sign=v / np.hypot(v, 1e-2),
        load=20 * generator.normal(size=n),
        coulomb=np.full(n, 5.0),
        current=generator.normal(size=n),
        t=np.linspace(0, 10, n),
        state=generator.uniform(size=n),
        driver=generator.normal(size=n),
    )
    of_law = len(units(effect, held, amplitude))
    for _ in range(10):
        c = generator.normal(size=of_law + len(terms))
        held |= {key: value for key, value in solved(effect, held, c[:of_law], amplitude).items() if key in held}
        columns = [law(values, signals) for values in units(effect, held, amplitude, terms)]
        assert not amplitude or all(np.any(column) for column in columns)
        whole = law(values_of(effect, solved(effect, held, c, amplitude, terms)), signals)
        np.testing.assert_allclose(whole, sum(k * x for k, x in zip(c, columns)), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE.keys())
def test_spans_one_plane_of_one_size(effect: Effect) -> None:
    """A phase or a shift belongs to one size; more than one spanned parameter has no closed form."""
    spanned = [p for p in effect.parameters if p.span is not None and p.span.values]
    assert len(spanned) <= 1
    assert not spanned or all(len(effect.sizes(p.name)) == 1 for p in effect.linear)


def test_first_moments_give_the_centre_of_a_payload() -> None:
    effect = next(e for e in CATALOGUE.values() if any(p.span is Span.MOMENT for p in e.parameters))
    assert solved(effect, {}, [2.0, 0.2, -0.4, 0.6]) == {"mass": 2.0, "x": 0.1, "y": -0.2, "z": 0.3}
    assert solved(effect, {}, [0.0, 0.2, -0.4, 0.6]) == {"mass": 0.0, "x": 0.0, "y": 0.0, "z": 0.0}
