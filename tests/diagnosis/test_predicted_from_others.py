"""What is judged is predicted from the rest: from other recordings, blocks and directions, not from itself."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm_model import Arm
from arm_model.tables import Uncertainty
from daq.recording import Recording
from diagnosis.another_day import known_in
from diagnosis.closed_loop.lanes import Lanes, predicted_lanes
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.search import Selection
from diagnosis.measurements.currents.shortage import shortage
from diagnosis.measurements.link_encoders.candidates import LinkCandidate
from diagnosis.measurements.link_encoders.model import LIMITS as LINK_LIMITS
from diagnosis.measurements.link_encoders.model import LinkEncoders
from diagnosis.measurements.near_rest.laws import Law, in_sample, predicted
from diagnosis.measurements.near_rest.passages import NearRest
from diagnosis.measurements.single_axis.columns import Rows
from diagnosis.measurements.single_axis.model import SingleAxis
from diagnosis.per_recording.single_recordings import predicted_gains
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from identification.selection import Score, Split
from tests.diagnosis.one_axis import FREE

ROWS = 600


def test_columns_that_follow_noise_gain_nothing_in_other_blocks() -> None:
    rng, block = np.random.default_rng(0), np.arange(ROWS) // 50
    x, noise = rng.normal(size=(ROWS, 20)), rng.normal(size=ROWS)
    assert predicted_gains(x, noise, noise, block).sum() < 0.0
    there = noise + x[:, 0]
    assert predicted_gains(x, there, there, block).sum() > 0.5 * ROWS


def test_of_many_trials_the_one_that_follows_the_noise_of_a_recording_does_not_predict_it() -> None:
    rng, trials = np.random.default_rng(1), 300
    noise = [rng.normal(size=60) for _ in range(4)]
    every = cast(list[NearRest], [SimpleNamespace(residual=one) for one in noise])
    law = Law(None, [{}] * trials, [np.zeros((trials, 60))] * 4, [rng.normal(size=(trials, 60)) for _ in noise])
    unexplained = sum(float(one @ one) for one in noise)
    assert in_sample(every, law).energy < unexplained < predicted(every, law).energy


def test_a_closed_loop_is_chosen_by_the_errors_of_other_recordings() -> None:
    """Squared errors of one lane in two recordings are 0 and 5, of the other 4 and 2."""
    errors = [np.sqrt(np.array([[0.0], [4.0]])), np.sqrt(np.array([[5.0], [2.0]]))]
    lanes = Lanes({}, errors, errors, [])
    assert lanes.best == 0
    first, second = predicted_lanes(lanes)[0]
    assert (first @ first, second @ second) == pytest.approx((4.0, 5.0))


@pytest.mark.parametrize(("backwards", "holds"), [(1.0, True), (-1.0, False)])
def test_what_acts_in_one_direction_only_does_not_hold_across_directions(backwards: float, holds: bool) -> None:
    gain, rng = Candidate("current_gain", 1), np.random.default_rng(2)
    v = np.sin(np.linspace(0.0, 20.0, ROWS))
    x = rng.normal(size=ROWS)
    residual = np.where(v > 0.0, x, backwards * x) + 0.1 * rng.normal(size=ROWS)
    zero = np.zeros(ROWS)
    rows = Rows(FREE, (), residual, zero, zero, v, np.zeros(ROWS, np.intp), 0.1)
    model = SingleAxis(Split(rows, rows), rows, one_run=False, cache={(id(rows), gain): x[:, None]})
    assert model.holds_across_directions(gain, []) is holds


def test_recordings_that_are_not_all_of_the_identification_are_of_another_day(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.another_day.digest", lambda recording: recording)
    arm: Arm = replace(FREE, uncertainty=Uncertainty("known.json", left_over=(1.0,), recordings=("a", "b")))

    def known(*names: str) -> Uncertainty:
        uncertainty = known_in(arm, cast(list[Recording], list(names))).uncertainty
        assert uncertainty is not None
        return uncertainty

    assert known("a").same_day and known("b", "a").left_over == ()
    assert not known("a", "c").same_day and known("a", "c").left_over == (1.0,)


@pytest.mark.parametrize(("gains", "short"), [((50.0, 60.0), True), ((50.0, -1.0), False)])
def test_more_seconds_are_asked_for_only_if_every_block_agrees(gains: tuple[float, ...], short: bool) -> None:
    block = np.repeat(np.arange(2, dtype=np.intp), 50)
    side = Dataset((), (), np.ones(100), block, 100)
    candidate = Candidate("viscous_friction", 1)
    score = Score(
        candidate=candidate,
        gain=99.0,
        p=0.25,
        blocks=np.array(gains),
        coefficients=np.ones(1),
        by_joint=np.array([99.0]),
    )
    model = SimpleNamespace(
        scores=lambda state: [score], fdr=lambda score: 0.05, admissible=lambda score, state: True, limits=LIMITS
    )
    state: Any = SimpleNamespace(model=model, data=Split(side, side), residual=Split(side.y, side.y))
    left: Any = SimpleNamespace(structures=[SimpleNamespace(joint=1)])
    found = shortage(Selection(state, left))
    assert (found is not None) is short
    # 2^-5 of five blocks is below 0.05
    assert found is None or (found.effect, found.seconds) == (candidate.key, 3.0)


def test_the_share_of_a_link_encoders_cause_is_of_both_parts_of_a_recording() -> None:
    """In the first it takes squares of 4 to 1, in the second it leaves 16: 3 of 20 in each row, and not 3 of 16."""
    rows, t = 400, np.arange(400) * 0.01
    parts = [
        SimpleNamespace(t=t, blocks=lambda seconds: (t // seconds).astype(np.intp), left=left)
        for left in ((2.0, 1.0), (4.0, 4.0))
    ]
    noise = np.where(np.arange(rows) % 2, 1.0, -1.0)[:, None]
    model: Any = SimpleNamespace(
        rows=Split(*parts, True),
        scale=np.ones(1),
        limits=LINK_LIMITS,
        affected=lambda candidate: [0],
        counted=lambda chosen, judged: None,
        # a part is judged by what it leaves, predicted from the other
        residual=lambda chosen, learned, judged, counted: noise * judged.left[len(chosen)] * (learned is not judged),
    )
    found = LinkEncoders.score(model, LinkCandidate("joint_compliance", 1), [])
    assert found.share == pytest.approx(3.0 / 20.0)
    assert found.gain == pytest.approx(3.0 * rows)
