"""The selection engine on ordinary regression: what enters, what leaves, and when it ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from identification.selection.least_squares import scaled_lstsq
from identification.selection.limits import Limits
from identification.selection.significance import p_value
from identification.selection.split import Split
from identification.selection.stepwise import MeasurementModel, Score, eliminate, forward, select

ROWS, BLOCK = 2000, 50
LIMITS = Limits(max_causes=6, min_gain=0.02, kept_gain=0.02)
Names = tuple[str, ...]


@dataclass
class Regression(MeasurementModel[str, Names]):
    """y = sum of named columns, each (m, k); gains are shares of the held-out energy that noise alone has."""

    columns: Split[dict[str, np.ndarray]]
    y: Split[np.ndarray]
    together: Names = ()
    limits: Limits = LIMITS
    seen: int = 0
    extensions: Names = ()

    def start(self) -> Names:
        return ()

    def chosen(self, state: Names) -> Names:
        return state

    def residual(self, names: Sequence[str]) -> np.ndarray:
        x = [np.column_stack([np.zeros((ROWS, 0)), *(part[name] for name in names)]) for part in self.columns]
        return self.y.held_out - x[1] @ scaled_lstsq(x[0], self.y.fit)

    def score(self, name: str, others: Sequence[str]) -> Score[str]:
        fall = self.residual(others) ** 2 - self.residual([*others, name]) ** 2
        blocks = np.bincount(np.arange(ROWS) // BLOCK, weights=fall)
        width = self.columns.fit[name].shape[1]
        return Score(candidate=name, gain=fall.sum(), p=p_value(blocks), blocks=blocks, coefficients=np.zeros(width))

    def scores(self, state: Names) -> list[Score[str]]:
        self.seen += 1
        return [self.score(name, state) for name in self.columns.fit if name not in state]

    def admissible(self, score: Score[str], state: Names) -> bool:
        return score.gain > self.limits.min_gain * ROWS

    def extends(self, score: Score[str]) -> bool:
        return score.candidate in self.extensions

    def tolerance(self, score: Score[str], best: Score[str]) -> float:
        return self.limits.tie * best.gain

    def entered(self, score: Score[str], admissible: Sequence[Score[str]], state: Names) -> Names:
        return (*state, score.candidate)

    def without(self, candidate: str, state: Names) -> Names:
        return tuple(name for name in state if name != candidate)

    def conditional(self, candidate: str, without: Names, state: Names) -> Score[str]:
        return self.score(candidate, without)

    def needed(self, score: Score[str], state: Names) -> bool:
        return score.gain > (self.limits.kept_gain or 0.0) * ROWS

    def stalled(self, state: Names) -> Names | None:
        return (*state, *self.together) if self.together and not set(self.together) & set(state) else None


def _regression(seed: int, truth: dict[str, float], noise: float = 1.0) -> Regression:
    """Columns a, b, c independent; mix = a + b; wide = a and five columns of noise."""
    rng = np.random.default_rng(seed)
    columns, y = [], []
    for _ in range(2):
        one = {name: rng.normal(size=(ROWS, 1)) for name in "abc"}
        one["mix"] = one["a"] + one["b"] + 0.1 * rng.normal(size=(ROWS, 1))
        one["wide"] = np.hstack([one["a"], rng.normal(size=(ROWS, 5))])
        columns.append(one)
        y.append(sum(size * one[name][:, 0] for name, size in truth.items()) + noise * rng.normal(size=ROWS))
    return Regression(Split(*columns), Split(*y))


@pytest.mark.parametrize("seed", range(5))
def test_what_is_there_is_chosen_and_nothing_else(seed: int) -> None:
    assert set(select(_regression(seed, {"a": 1.0, "c": 0.5}))) == {"a", "c"}
    assert select(_regression(seed, {})) == ()


@pytest.mark.parametrize("seed", range(5))
def test_what_entered_first_leaves_when_others_make_it_superfluous(seed: int) -> None:
    """The sum of two effects explains more than either, and nothing once both are there."""
    model = _regression(seed, {"a": 1.0, "b": 1.0})
    first = max(model.scores(()), key=lambda score: score.gain).candidate
    assert first == "mix"
    assert set(eliminate(model, ("mix", "a", "b"))) == {"a", "b"}


def test_of_equals_the_one_with_the_fewest_coefficients_enters() -> None:
    model = _regression(0, {"a": 1.0})
    model.columns = Split(*({"wide": part["wide"], "a": part["a"]} for part in model.columns))
    model.limits = replace(LIMITS, tie=0.05)
    assert select(model) == ("a",)


@pytest.mark.parametrize(("extensions", "entered"), [((), False), (("a",), True)])
def test_an_extension_of_what_is_chosen_is_not_one_test_of_all(extensions: Names, entered: bool) -> None:
    """A law that changes for a few seconds of the recording was one of many effects, and its imitators came in."""
    model = _regression(0, {"a": 1.0})
    rng, shown = np.random.default_rng(1), (np.arange(ROWS) < 7 * BLOCK)[:, None]
    for part in model.columns:
        part["a"] *= shown
        part |= {f"n{k}": rng.normal(size=(ROWS, 1)) for k in range(60)}
        del part["mix"], part["wide"]
    model.y = model.y.map(lambda y: rng.normal(size=ROWS))
    model.y = Split(*(y + part["a"][:, 0] for y, part in zip(model.y, model.columns)))
    model.extensions = extensions
    state = forward(model, ())
    assert (state == ("a",)) is entered


def test_those_that_hide_each_other_enter_together_where_the_search_stalls() -> None:
    model = _regression(0, {})
    model.together = ("a", "b")
    assert model.stalled(()) == ("a", "b")
    # each is superfluous conditional on the other: the last one stays, as at least one entered
    assert len(select(model)) <= 1


def test_final_significance_is_asked_conditional_on_all_others() -> None:
    model = _regression(3, {"a": 1.0})
    model.limits = replace(LIMITS, kept_gain=-1e9)
    kept = eliminate(model, ("a", "b", "c"), fdr=0.05, tests=5)
    assert kept == ("a",)
    assert eliminate(_regression(3, {}), ("b",), fdr=0.05, tests=5) == ()


def test_the_search_ends() -> None:
    """What enters and is eliminated in the same round ends the search, and so do its limits."""
    model = _regression(0, {"a": 1.0, "b": 0.8, "c": 0.6})
    model.limits = replace(LIMITS, max_causes=2)
    assert len(select(model)) <= 2
    model = _regression(0, {"a": 1.0})
    # whatever enters after the first is thrown out at once
    model.limits = replace(LIMITS, min_gain=-1.0, fdr=None, kept_gain=1e9)
    assert len(select(model)) == 1
    assert model.seen <= 3


def test_progress_is_told_by_round() -> None:
    said: list[str] = []
    select(_regression(0, {"a": 1.0}), said.append)
    assert said == ["looking for causes: cause 1", "looking for causes: cause 2"]


def test_two_parts_of_one_recording_are_predicted_from_each_other() -> None:
    assert Split("a", "b").folds() == [("a", "b")]
    assert Split("a", "b", two_fold=True).folds() == [("a", "b"), ("b", "a")]
    assert Split(1, 2, two_fold=True).map(lambda one: -one) == Split(-1, -2, two_fold=True)
