"""The shipped table is the one that the bank gives; what it states is monotone, and no surer than what was counted."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from diagnosis.cause import MAX_CONFIDENCE, Signal, Support
from diagnosis.confidence import TABLE, deserved
from diagnosis.confidence import stated as stated_of
from tests.confidence.bank import Key, Name, puma_chosen, read, replaced, write
from tests.confidence.cross_validation import by_other_cases, confirmed, cross_validated, reliability
from tests.confidence.fit import COUNTED, LEAST, SUREST, fitted, level, levels, stated, steps
from tests.diagnosis.runs import group_of

CHANCE = 0.025
"""Of a count that is further than this from what was stated, on one side: about two standard deviations."""


@pytest.fixture(scope="module")
def judged() -> tuple[np.ndarray, np.ndarray, float]:
    """(n,) stated of each name by the table of the other cases, whether it was right, and the most that is stated."""
    names = read()
    confidence, most = cross_validated(names)
    return confidence, np.array([name.right for name in names]), most


def test_the_shipped_table_is_fitted_to_the_bank(judged: tuple[np.ndarray, np.ndarray, float]) -> None:
    shipped = json.loads(TABLE.read_text())
    again = fitted(read(), judged[2])
    np.testing.assert_allclose(shipped["weights"], again["weights"], atol=1e-3)
    assert (shipped["steps"], shipped["beside"]) == (again["steps"], again["beside"])
    assert shipped["provenance"]["names"] == len(read())


def test_names_state_the_confidence_of_the_table() -> None:
    shipped = json.loads(TABLE.read_text())
    for name in read():
        assert stated(shipped, name) == min(name.support.significance, deserved(name.support))


def test_steps_rise_and_count_what_was_right() -> None:
    table = json.loads(TABLE.read_text())
    counted = table["steps"]
    assert all(low["from"] < high["from"] for low, high in itertools.pairwise(counted))
    assert all(low["confidence"] < high["confidence"] for low, high in itertools.pairwise(counted))
    for step in counted:
        assert step["names"] >= LEAST
        assert step["confidence"] <= (step["right"] + 1) / (step["names"] + 2) + 1e-3
    assert sum(step["names"] for step in counted) + table["beside"]["names"] == len(read())


def test_what_steps_state_rises_whatever_the_counts() -> None:
    """A small step whose names were all right states less than a large one with a wrong name: they are pooled."""
    rng = np.random.default_rng(2)
    for count, share in itertools.product((26, 80, 240), (0.3, 0.9, 0.97, 1.0)):
        score = np.sort(rng.normal(size=count))
        right = (rng.uniform(size=count) < share).astype(float)
        made = steps(score, right)
        assert all(low["confidence"] < high["confidence"] for low, high in itertools.pairwise(made))
        assert sum(one["names"] for one in made) == count and sum(one["right"] for one in made) == right.sum()
        for one, after in itertools.zip_longest(made, made[1:]):
            inside = (score >= one["from"] - 1e-4) & (score < (after["from"] - 1e-4 if after else np.inf))
            assert one["confidence"] == level(int(inside.sum()), right[inside].sum())


def test_more_evidence_never_lowers_the_confidence() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        gain, left, sureness = np.exp(rng.uniform(0, 4, 3))
        less = Support(significance=0.98, gain=gain, left=left, sureness=sureness, names=3, unexplained=1)
        more = Support(significance=0.98, gain=2 * gain, left=left / 2, sureness=2 * sureness, names=2, unexplained=0)
        assert deserved(less) <= deserved(more) <= MAX_CONFIDENCE


def test_a_case_is_judged_by_a_table_that_does_not_know_it() -> None:
    names = read()[:60]
    case = names[0].key
    turned = [replace(name, right=not name.right) if name.key == case else name for name in names]
    before, after = (by_other_cases(bank, 1.0) for bank in (names, turned))
    own = np.array([name.key == case for name in names])
    np.testing.assert_array_equal(before[own], after[own])
    assert (before[~own] != after[~own]).any()


def test_names_are_predicted_better_than_by_p_values(judged: tuple[np.ndarray, np.ndarray, float]) -> None:
    confidence, right, _ = judged
    before = np.array([name.support.significance for name in read()])
    assert np.mean((confidence - right) ** 2) < np.mean((before - right) ** 2)


def test_every_level_is_right_as_often_as_it_states(judged: tuple[np.ndarray, np.ndarray, float]) -> None:
    """Neither seldomer nor oftener than by chance; 1 - p alone is right too seldom."""
    confidence, right, _ = judged
    counts = reliability(confidence, right, levels(json.loads(TABLE.read_text())))
    assert len(counts) > 1 and sum(names for _, names, _ in counts) == len(right)
    for mean, names, hits in counts:
        assert binom.cdf(hits, names, mean) > CHANCE
        assert binom.sf(hits - 1, names, mean) > CHANCE
    assert binom.cdf(right.sum(), len(right), MAX_CONFIDENCE) < CHANCE


@pytest.mark.parametrize("signal", [Signal.TRACKER, Signal.LINK_ANGLE])
def test_what_the_bank_has_no_case_of_is_stated_no_surer_than_what_was_counted(signal: Signal) -> None:
    most = max(step["confidence"] for step in json.loads(TABLE.read_text())["steps"])
    cause = replace(group_of(("joint_zero_offset", 1)), signal=signal, confidence=MAX_CONFIDENCE)
    assert [one.confidence for one in stated_of([cause], {}, 0)] == [min(MAX_CONFIDENCE, most)]
    assert stated_of([replace(cause, confidence=0.2)], {}, 0)[0].confidence == 0.2


def test_98_percent_is_stated_only_where_98_of_100_were_right() -> None:
    for right, names, most in ((99, 99, 0.97), (98, 100, 0.981), (97, 100, 0.97), (500, 500, 1.0), (40, 60, 0.67)):
        assert level(names, right) <= most
    assert level(500, 500) >= 0.98 > level(99, 99)
    assert level(500, 500, SUREST) == SUREST


@pytest.mark.parametrize(
    ("puma", "foreign", "wrong", "may"),
    [(0, 100, 2, True), (150, 100, 2, True), (0, 99, 0, False), (500, 99, 0, False), (500, 100, 3, False)],
)
def test_98_percent_takes_98_of_100_names_of_foreign_arms(puma: int, foreign: int, wrong: int, may: bool) -> None:
    """Judged by tables of other cases; ``wrong``: of the foreign ones. Names that were given less have no say."""
    confidence = np.repeat([0.98, 0.5], (puma + foreign, 200))
    number = np.arange(len(confidence))
    right = (number >= wrong) & (number < puma + foreign)
    assert confirmed(confidence, right, (number < foreign) | (number >= puma + foreign)) == may


def test_the_shipped_table_states_98_percent_only_if_both_counts_do(
    judged: tuple[np.ndarray, np.ndarray, float],
) -> None:
    confidence, right, most = judged
    said = [step for step in json.loads(TABLE.read_text())["steps"] if round(100 * step["confidence"]) >= 98]
    assert all(step["names"] >= COUNTED and step["right"] >= 0.98 * step["names"] for step in said)
    foreign = np.array([name.suite != "puma" for name in read()])
    assert not said or (most == 1.0 and confirmed(confidence, right, foreign))


def test_a_bank_of_enough_right_names_states_98_percent() -> None:
    name = next(one for one in read() if one.right)
    evidence = [replace(name.support, gain=2.0 + at / 100.0) for at in range(110)]
    bank = [replace(name, suite="foreign-first", seed=at, support=support) for at, support in enumerate(evidence)]
    confidence, most = cross_validated(bank)
    assert most == 1.0 and round(100 * confidence.max()) == 98
    assert round(100 * fitted(bank, most)["steps"][-1]["confidence"]) == 99


def test_a_case_is_replaced_with_all_its_names(tmp_path: Path) -> None:
    names = read()
    case, other = names[0].key, next(name for name in names if name.key != names[0].key)
    new: dict[Key, list[Name]] = {case: [], ("puma", 1, "new"): [replace(other, suite="puma", seed=1, case="new")]}
    now = replaced(names, new)
    assert case not in {name.key for name in now} and other in now
    assert len(now) == sum(name.key != case for name in names) + 1
    write(now, tmp_path / "bank.json")
    assert sorted(map(repr, read(tmp_path / "bank.json"))) == sorted(map(repr, now))


def test_cases_are_chosen_by_words_of_their_names() -> None:
    every = puma_chosen(51301, 30, ())
    some = puma_chosen(51301, 30, ("stribeck", "presliding"))
    assert 0 < len(some) < len(every)
    assert {one.name for one in some} == {
        one.name for one in every if "stribeck" in one.name or "presliding" in one.name
    }


def test_a_name_beside_what_is_unexplained_states_no_more_than_such_names_were_right() -> None:
    """However much it explains: EMPS is 47 times its noise beside three names."""
    most = json.loads(TABLE.read_text())["beside"]["confidence"]
    sure = Support(significance=0.98, gain=100.0, left=1.0, sureness=50.0, names=1, unexplained=0)
    assert deserved(replace(sure, left=47.0)) <= deserved(replace(sure, unexplained=1)) == most < deserved(sure)
