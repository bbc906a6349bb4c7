"""The shipped table is the one that the bank gives; what it states is monotone, and no surer than what was counted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.cause import MAX_CONFIDENCE, Signal, Support
from diagnosis.confidence import TABLE, deserved
from diagnosis.confidence import stated as stated_of
from tests.confidence.__main__ import judged
from tests.confidence.bank import Key, Name, puma_chosen, read, replaced, write
from tests.confidence.fit import fitted, halves, level, stated
from tests.diagnosis.runs import group_of


def test_the_shipped_table_is_fitted_to_half_of_the_bank() -> None:
    shipped = json.loads(TABLE.read_text())
    again = fitted(halves(read())[0])
    np.testing.assert_allclose(shipped["weights"], again["weights"], atol=1e-3)
    assert (shipped["steps"], shipped["beside"]) == (again["steps"], again["beside"])


def test_names_state_the_confidence_of_the_table() -> None:
    shipped = json.loads(TABLE.read_text())
    for name in read():
        assert stated(shipped, name) == min(name.support.significance, deserved(name.support))


def test_steps_rise_and_count_what_was_right() -> None:
    steps = json.loads(TABLE.read_text())["steps"]
    assert [step["from"] for step in steps] == sorted(step["from"] for step in steps)
    confidences = [step["confidence"] for step in steps]
    assert confidences == sorted(confidences)
    for step in steps:
        assert step["confidence"] <= (step["right"] + 1) / (step["names"] + 2) + 1e-3


def test_more_evidence_never_lowers_the_confidence() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        gain, left, sureness = np.exp(rng.uniform(0, 4, 3))
        less = Support(significance=0.98, gain=gain, left=left, sureness=sureness, names=3, unexplained=1)
        more = Support(significance=0.98, gain=2 * gain, left=left / 2, sureness=2 * sureness, names=2, unexplained=0)
        assert deserved(less) <= deserved(more) <= MAX_CONFIDENCE


def test_the_other_half_is_predicted_better_than_by_p_values() -> None:
    figures = judged(json.loads(TABLE.read_text()), read())
    assert figures["brier"] < figures["before_brier"]


def test_what_is_stated_of_the_other_half_is_right_as_often() -> None:
    """High confidence within two standard deviations of a count of that many names; low confidence is mostly wrong."""
    table, names = json.loads(TABLE.read_text()), halves(read())[1]
    confidence, right = np.array([(stated(table, name), name.right) for name in names]).T
    high, low = confidence >= 0.9, confidence < 0.5
    mean, count = confidence[high].mean(), high.sum()
    assert right[high].mean() >= mean - 2 * np.sqrt(mean * (1 - mean) / count)
    assert right[low].mean() < 0.5


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
    assert deserved(replace(sure, unexplained=1)) == deserved(replace(sure, left=47.0)) == most < deserved(sure)
