"""Samples that are none, NaN or flagged by their instrument: the arm is judged by the others, and a warning says which.

Held currents were a friction 40 times the noise, and a single NaN refused the whole recording.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm
from daq.recording import Recording
from diagnosis.diagnose import diagnose
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.remainder.against_noise import against_noise, ratios, runs_of
from diagnosis.screening.lost_rows.blank_samples import Blank, blanks_of, sentences, unweighted, without_blanks
from diagnosis.screening.plausibility import check
from drivers.protocols import Quality
from tests.comparison.second_day import puma
from tests.diagnosis.test_skipped_rows import RATE, _recorded

HELD = tuple(range(300, 3500, 800))
"""First rows of holds of 0.4 s."""


def _flagged(recording: Recording, channel: str, rows: slice | list[int], flag: Quality) -> Recording:
    """The recording as of a rig of two counters and two inputs, with a flag on some rows of a joint's channel."""
    joints = recording.joints
    quality = np.zeros((len(recording.t), 2 * joints), np.uint8) if recording.quality is None else recording.quality
    quality = quality.copy()
    quality[rows, int(channel[1:]) - 1 + (joints if channel[0] == "i" else 0)] |= np.uint8(flag)
    layout = replace(recording.layout, counters=("c",) * joints, inputs=("v",) * joints)
    table = {"count_column": list(range(joints)), "volt_column": list(range(joints))}
    files = recording.attachments | {"calibration.json": json.dumps(table).encode()}
    return replace(recording, quality=quality, layout=layout, attachments=files)


def _held(recording: Recording, flag: Quality) -> Recording:
    """Currents of joint 2 that were repeated in holds of 0.4 s, with the flag on them."""
    i, rows = recording.i.copy(), []
    for start in HELD:
        i[start : start + 100, 1] = i[start, 1]
        rows += range(start, start + 100)
    return _flagged(replace(recording, i=i), "i2", rows, flag)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root, 2)


@pytest.fixture(scope="module")
def runs(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    folder = tmp_path_factory.mktemp("runs")
    return [_recorded(folder / f"{seed}.mcap", arm, seed) for seed in (1, 2, 3)]


def test_held_currents_are_left_out_where_the_instrument_says_so(arm: Arm, runs: list[Recording]) -> None:
    flagged = [_held(one, Quality.STALE) for one in runs]
    silent = [replace(one, quality=None) for one in flagged]
    assert diagnose(arm, silent[:2], silent[2:]).verdict != "consistent"
    result = diagnose(arm, flagged[:2], flagged[2:])
    assert (result.verdict, result.causes, result.unexplained) == ("consistent", [], [])
    assert result.warnings == tuple(
        f"{k}.mcap: i2: 400 of 3750 rows marked STALE by the instrument; left out" for k in (1, 2, 3)
    )
    assert all(one.ratio < 1.3 for one in against_noise(arm, flagged[:1]))


def test_missing_samples_are_left_out(arm: Arm, runs: list[Recording]) -> None:
    q, i = runs[0].q.copy(), runs[0].i.copy()
    q[1000, 0] = i[2000:2030, 1] = np.nan
    result = diagnose(arm, [replace(runs[0], q=q, i=i), runs[1]], runs[2:])
    assert (result.verdict, result.causes) == ("consistent", [])
    assert result.warnings == (
        "1.mcap: q1: 1 of 3750 rows without a value, the first at 4.000 s; left out",
        "1.mcap: i2: 30 of 3750 rows without a value, the first at 8.000 s; left out",
    )


def test_samples_are_interpolated_and_others_stay(runs: list[Recording]) -> None:
    recording = runs[0]
    late = _flagged(recording, "q1", slice(500, 520), Quality.LATE)
    late = replace(late, q=late.q.copy())
    late.q[500:520, 0] += 1.0
    whole = without_blanks(late)
    np.testing.assert_allclose(whole.q, recording.q, atol=2e-3)
    rows = np.ones(len(recording.t), bool)
    rows[500:520] = False
    np.testing.assert_array_equal(whole.q[rows], recording.q[rows])
    np.testing.assert_array_equal(whole.i, recording.i)
    (blank,) = blanks_of(late)
    assert blank == Blank(pytest.approx(499 / RATE), pytest.approx(520 / RATE), None)
    assert without_blanks(recording) is recording and blanks_of(recording) == () and sentences(recording) == []


def test_currents_at_the_end_of_their_range_weigh_nothing_and_stay(arm: Arm, runs: list[Recording]) -> None:
    """The searches for limits see them."""
    clipped = _flagged(runs[0], "i2", slice(500, 520), Quality.SATURATED)
    np.testing.assert_array_equal(without_blanks(clipped).i, runs[0].i)
    (blank,) = blanks_of(clipped)
    assert blank.joint == 2


def test_blanks_of_one_current_leave_the_weight_of_other_joints(arm: Arm, runs: list[Recording]) -> None:
    (run,) = runs_of(arm, runs[:1], [])
    less = unweighted(run, [Blank(4.0, 4.4, 2)])
    heavy = (run.t > 3.95) & (run.t < 4.45)
    assert (less.deviation[heavy, 1] > 1e5 * run.deviation[heavy, 1]).all()
    np.testing.assert_array_equal(less.deviation[~heavy], run.deviation[~heavy])
    np.testing.assert_array_equal(less.deviation[:, 0], run.deviation[:, 0])
    assert unweighted(run, ()) is run


def test_samples_that_another_recording_lacks_leave_the_noise_known(arm: Arm, runs: list[Recording]) -> None:
    """As ``identify`` asks, of what it held out beside what it fitted: their noise was none, and no SVD converged."""
    i = runs[1].i.copy()
    i[2000:2030, 1] = np.nan
    found = against_noise(arm, runs[:1], [replace(runs[1], i=i)])
    assert [one.joint for one in found] == [1, 2] and all(0.7 < one.ratio < 1.3 for one in found)


def test_a_residual_of_which_nothing_is_left_is_zero_times_the_noise(arm: Arm, runs: list[Recording]) -> None:
    """All of it may lie in what is free in a recording."""
    (run,) = runs_of(arm, runs[:1], [])
    for one, plain in zip(ratios([run], np.zeros(run.residual.size)), ratios([run], dataset_of([run]).y), strict=True):
        assert (one.error, one.ratio) == (0.0, 0.0)
        assert one.floor == pytest.approx(plain.floor, rel=0.2)


@pytest.mark.parametrize(("channel", "step"), [("q", 1), ("i", 1), ("q", 10)])
def test_too_few_samples_are_refused(arm: Arm, runs: list[Recording], channel: str, step: int) -> None:
    values = getattr(runs[0], channel).copy()
    values[500:3000:step, 1] = np.nan
    with pytest.raises(InputError, match=rf"1.mcap: {channel}2: .*% of the rows have no value, the first at 2.000 s"):
        check(arm, [replace(runs[0], **{channel: values})])
