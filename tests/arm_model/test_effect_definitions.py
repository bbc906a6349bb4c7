"""Every effect of the vocabulary is defined once, completely, and its law runs on arrays and on symbols alike."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy

from arm_model.effects import CATALOGUE, Effect, Excitation, Instrument, Parameter, Signals, Values

LAWS = ("torque", "deflection", "angle", "current", "delay", "change", "limit", "bend", "late", "stray")


def _random_signals(rng: np.random.Generator, n: int = 50) -> Signals:
    v = rng.normal(size=n)
    return Signals(
        q=rng.normal(size=n),
        v=v,
        a=rng.normal(size=n),
        motor=rng.normal(size=n) * 60,
        sign=v / np.sqrt(v**2 + 1e-4),
        load=rng.normal(size=n) * 20,
        coulomb=np.full(n, 5.0),
        current=rng.normal(size=n),
        torque=rng.normal(size=n),
        t=np.linspace(0, 10, n),
        state=rng.normal(size=n) * 1e-4,
        twist=rng.normal(size=n) * 1e-3,
        twist_rate=v * 1e-2,
    )


def _typical(effect: Effect, scale: float = 1.0) -> Values:
    return Values({p.name: p.typical[1] * (scale if p.linear else 1.0) for p in effect.parameters})


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE.keys())
def test_has_one_law_and_says_what_it_is(effect: Effect) -> None:
    laws = [name for name in LAWS if getattr(effect, name) is not None] + ["coupling"] * effect.coupling
    assert len(laws) == (len(effect.linear) if effect.wave else 1)
    assert effect.equation and effect.shows
    assert all(name in CATALOGUE for name in effect.confused_with)


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE.keys())
def test_says_by_which_instrument_it_is_observed_what_excites_it_and_where_its_parameters_are_searched(
    effect: Effect,
) -> None:
    assert effect.observed_by
    assert all(isinstance(instrument, Instrument) for instrument in effect.observed_by)
    assert isinstance(effect.excited_by, Excitation)
    regressed = {Instrument.CURRENT, Instrument.SINGLE_AXIS, Instrument.CLOSED_LOOP} & set(effect.observed_by)
    for parameter in effect.parameters:
        if regressed and effect.delay is None:
            assert _found(parameter), f"{effect.name}.{parameter.name}: neither a coefficient nor spanned nor searched"
        assert all(np.isfinite(parameter.search)) and list(parameter.search) == sorted(parameter.search)
        assert all(abs(value) <= parameter.most for value in parameter.search)
        if len(parameter.search) > 1 and parameter.typical[0] > 0 and not parameter.derived:
            low, high = parameter.typical
            assert parameter.search[0] <= low * (1 + 1e-9) and parameter.search[-1] >= high * (1 - 1e-9)
        assert parameter.scale is None or parameter.shares
        assert parameter.most >= parameter.typical[1]
    if Instrument.TRACKER in effect.observed_by and effect.stray is None:
        assert any(p.tracker_prior or p.chain for p in effect.parameters)


def _found(parameter: Parameter) -> bool:
    """How an estimator finds it: as a coefficient, by its plane, by a search, or from joint or recordings."""
    return parameter.linear or parameter.span is not None or bool(parameter.search) or parameter.own or parameter.lasts


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE.keys())
def test_names_other_effects_by_names_that_exist(effect: Effect) -> None:
    named = [*effect.aliases, *effect.special_cases, *effect.near_cases]
    named += [name for observation in effect.observed_by.values() for name in observation.aliases]
    assert set(named) <= set(CATALOGUE) - {effect.name}
    assert not set(effect.special_cases) & {*effect.aliases, *effect.near_cases}


@pytest.mark.parametrize("name", [name for name, effect in CATALOGUE.items() if effect.special_cases])
def test_contains_its_special_cases(name: str) -> None:
    """While the joint moves, the torque of each special case is a combination of the effect's own columns."""
    whole, signals = CATALOGUE[name], _random_signals(np.random.default_rng(7))
    signals = replace(signals, sign=np.sign(signals.v))
    columns = _columns(whole, signals)
    for part in whole.special_cases:
        for column in _columns(CATALOGUE[part], signals).T:
            rest = column - columns @ np.linalg.lstsq(columns, column, rcond=None)[0]
            np.testing.assert_allclose(rest, 0.0, atol=1e-9 * np.linalg.norm(column))


def _columns(effect: Effect, signals: Signals) -> np.ndarray:
    law = effect.torque or effect.current
    assert law is not None
    ones = [{p.name: float(p is one) for p in effect.parameters} for one in effect.linear]
    return np.column_stack([law(Values(one), signals) for one in ones])


def over_signals(effect: Effect) -> Any:
    return (
        effect.torque
        or effect.deflection
        or effect.angle
        or effect.current
        or effect.bend
        or effect.late
        or effect.stray
    )


@pytest.mark.parametrize("name", [name for name, e in CATALOGUE.items() if e.linear and over_signals(e)])
def test_law_is_linear_in_what_it_calls_linear(name: str) -> None:
    effect = CATALOGUE[name]
    law = over_signals(effect)
    signals = _random_signals(np.random.default_rng(3))
    once, twice = law(_typical(effect), signals), law(_typical(effect, 2.0), signals)
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-12, atol=1e-12)


def any_law(effect: Effect) -> Any:
    """None where the law is another arm."""
    return over_signals(effect) or effect.delay or effect.spring


@pytest.mark.parametrize("name", [name for name, effect in CATALOGUE.items() if any_law(effect)])
def test_symbols_give_the_numbers_of_the_law(name: str) -> None:
    import sympy

    effect = CATALOGUE[name]
    law = any_law(effect)
    numbers = {name: float(k + 1) / 7 for k, name in enumerate(Signals.__dataclass_fields__)}
    symbols = {name: sympy.Symbol(name) for name in numbers}
    values = _typical(effect)
    printed = law(Values({k: sympy.Symbol(f"p_{k}") for k in values}), Signals(**symbols))
    number = law(values, Signals(**{k: np.float64(v) for k, v in numbers.items()}))
    replaced = sympy.sympify(printed).subs(
        {f"p_{k}": v for k, v in values.items()} | {symbols[k]: v for k, v in numbers.items()}
    )
    assert float(replaced) == pytest.approx(float(number), rel=1e-9, abs=1e-12)


def test_vocabulary_is_complete(shared: Path) -> None:
    table = (shared / "effects.md").read_text(encoding="utf-8")
    names = {
        line.split("|")[1].strip() for line in table.splitlines() if line.startswith("| ") and "name" not in line[:7]
    }
    assert names <= set(CATALOGUE)


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=lambda effect: effect.name)
def test_a_size_reads_as_a_sentence_part(effect: Effect) -> None:
    """By words, not by symbols such as mu, c54 or d_theta; coordinates keep theirs."""
    for one in effect.parameters:
        words = one.sized("3 N m")
        assert words.count("3 N m") == 1 and words.startswith(("a ", "an ")) and "{" not in words
        coordinate = re.fullmatch(r"an? (m?[xyz]|i[xyz]{2}) of 3 N m", words)
        noun = re.sub(r"^an? |3 N m", "", words)
        assert coordinate or not re.search(r"\b(mu|[a-z]\d+|[a-z]|\w*_\w*)\b", noun), words


@pytest.mark.parametrize("effect", [one for one in CATALOGUE.values() if one.leading], ids=lambda one: one.name)
def test_the_leading_equation_is_the_equation_without_its_smaller_terms(effect: Effect) -> None:
    """By sympy: with the symbols that only the whole equation has set to 0."""
    whole, leading = (_right_side(text) for text in (effect.equation, effect.leading))
    smaller = whole.free_symbols - leading.free_symbols - {sympy.Symbol(name) for name in ("t", "te")}
    assert smaller and sympy.simplify(whole.subs(dict.fromkeys(smaller, 0)) - leading) == 0


def _right_side(equation: str) -> sympy.Expr:
    text = re.sub(r"\|(\w+)\|", r"Abs(\1)", equation.split(" = ")[1].replace("q'", "rate")).replace("^", "**")
    text = re.sub(r"(?<=[\w)]) (?=[\w(])", "*", text.replace("min(t, te)", "Min(t,te)"))
    names = {name: sympy.Symbol(name) for name in ("A", "B", "F", "T", "rate", "k", "q", "q0", "i", "phi", "Np")}
    return sympy.sympify(text, locals=names)
