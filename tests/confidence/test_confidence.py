"""The shipped table is the one that the bank gives; what it states is monotone, and no surer than what was counted."""

from __future__ import annotations

import json

import numpy as np

from diagnosis.cause import MAX_CONFIDENCE, Support
from diagnosis.confidence import TABLE, deserved
from tests.confidence.__main__ import judged
from tests.confidence.bank import read
from tests.confidence.fit import fitted, halves, stated


def test_the_shipped_table_is_fitted_to_half_of_the_bank() -> None:
    shipped = json.loads(TABLE.read_text())
    again = fitted(halves(read())[0])
    np.testing.assert_allclose(shipped["weights"], again["weights"], atol=1e-3)
    assert shipped["steps"] == again["steps"]


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
