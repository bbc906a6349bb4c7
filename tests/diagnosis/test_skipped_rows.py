"""Rows that a logger lost, as its stamps say: no trigger was dropped, and the arm is judged by what is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.diagnose import diagnose
from diagnosis.remainder.against_noise import against_noise
from diagnosis.residual.noise.encoder_step import encoder_step
from diagnosis.screening.lost_rows.blank_samples import without_blanks
from diagnosis.screening.lost_rows.skipped_rows import Hole, filled, holes_of
from tests.comparison.second_day import motion, puma
from tests.diagnosis.one_axis import currents

RATE = 250.0
LOST = ((700, 5), (1500, 40), (2600, 12))
"""First row and number of rows of each loss."""


def _recorded(path: Path, arm: Arm, seed: int, lost: tuple[tuple[int, int], ...] = (), late: int = 0) -> Recording:
    """15 s at 250 Hz without the rows ``lost``; currents ``late`` rows late from 9 s on."""
    rng, t = np.random.default_rng(seed), np.arange(3750) / RATE
    q, qd, qdd = motion(t, len(arm), seed, 1.6)
    i = currents(arm, q, qd, qdd) + 0.01 * rng.standard_normal(q.shape)
    if late:
        i[2250:] = i[2250 - late : -late]
    kept = np.ones(len(t), bool)
    for row, count in lost:
        kept[row : row + count] = False
    write_table(path, t[kept], {"q": np.round(q[kept] / 1e-5) * 1e-5, "i": i[kept]}, Attachments())
    return open_recording(path)


def test_rows_that_stamps_leave_out_are_no_dropped_trigger(tmp_path: Path, root: Path) -> None:
    """They were named one, of counters and of currents, and left 45 times the noise."""
    arm = puma(root, 2)
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed, LOST if seed == 1 else ()) for seed in (1, 2, 3)]
    result = diagnose(arm, runs[:2], runs[2:])
    assert (result.verdict, [cause.key for cause in result.causes]) == ("consistent", [])
    (said,) = result.warnings
    assert "1.mcap: 57 rows are missing by its time stamps" in said and "40 after 5.996 s" in said
    # the yardstick of identify does not take them for an error of the model either
    assert all(one.ratio < 1.3 for one in against_noise(arm, runs[:1]))


def test_single_rows_that_a_logger_lost_are_no_causes(tmp_path: Path, root: Path) -> None:
    """One in a hundred, as of a bag whose messages lack efforts: each was named missed counts of every joint."""
    arm = puma(root, 2)
    lost = tuple((int(row), 1) for row in np.sort(np.random.default_rng(4).choice(3700, 37, replace=False)) + 20)
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed, lost) for seed in (1, 2, 3)]
    result = diagnose(arm, runs[:2], runs[2:])
    assert (result.verdict, [cause.key for cause in result.causes]) == ("consistent", [])
    assert any("1.mcap: 37 rows are missing by its time stamps" in said for said in result.warnings)


def test_a_trigger_that_was_dropped_is_found_beside_rows_left_out(tmp_path: Path, root: Path) -> None:
    arm = puma(root, 2)
    runs = [
        _recorded(tmp_path / f"{seed}.mcap", arm, seed, LOST[:2] if seed == 1 else (), 6 if seed == 1 else 0)
        for seed in (1, 2, 3)
    ]
    result = diagnose(arm, runs[:2], runs[2:])
    (cause,) = result.causes
    values = {p.name: p.value for p in cause.parameters}
    assert cause.key == ("dropped_trigger", None) and abs(values["count"]) == 6
    assert values["row"] * values["period"] == pytest.approx(9.0, abs=0.3)


def test_holes_are_filled_at_their_instants_and_rows_stay(tmp_path: Path, root: Path) -> None:
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, LOST)
    holes = holes_of(recording.t)
    assert [(hole.row, hole.rows) for hole in holes] == [(700, 5), (1495, 40), (2555, 12)]
    whole = filled(recording, holes)
    np.testing.assert_allclose(whole.t, np.arange(3750) / RATE, atol=1e-9)
    measured = np.ones(3750, bool)
    for row, count in LOST:
        measured[row : row + count] = False
    np.testing.assert_array_equal(whole.q[measured], recording.q)
    np.testing.assert_array_equal(whole.number[measured], recording.number)
    exact = motion(whole.t, 2, 1, 1.6)[0]
    assert np.abs(whole.q - exact)[~measured].max() < 0.1 * np.ptp(exact)
    assert filled(recording, ()) is recording


@pytest.mark.parametrize("step", [1e-5, 9e-5])
def test_what_is_filled_in_is_what_the_encoder_would_have_read(tmp_path: Path, root: Path, step: float) -> None:
    """Angles between its steps made 12 missed counts 61 of a fifth of a step."""
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, LOST)
    recording = replace(recording, q=np.round(recording.q / step) * step)
    whole = filled(recording, holes_of(recording.t))
    blank = replace(recording, q=np.where(np.arange(len(recording.t))[:, None] % 400 == 7, np.nan, recording.q))
    for q in (whole.q, without_blanks(blank).q):
        assert [encoder_step(column) for column in q.T] == pytest.approx([step, step], rel=1e-6)
        np.testing.assert_allclose(q / step, np.round(q / step), atol=1e-6)


def test_jitter_is_no_hole() -> None:
    rng = np.random.default_rng(1)
    assert holes_of((np.arange(5000) + 0.2 * np.clip(rng.normal(size=5000), -2, 2)) / RATE) == ()
    assert holes_of(np.array([0.0])) == holes_of(np.zeros(0)) == ()
    # a stamp that is late, and the next one in time again
    late = np.arange(1000) / RATE
    late[500] += 0.9 / RATE
    assert holes_of(late) == ()
    # 980 rows per second with stamps in whole ms
    assert holes_of(np.round(np.arange(5000) / 0.98) / 1000) == ()


def test_a_single_row_is_a_hole_where_stamps_hardly_jitter() -> None:
    rng = np.random.default_rng(2)
    t = (np.arange(5000) + 0.02 * rng.normal(size=5000)) / RATE
    lost = [1, 700, 702, 2000, 4998]
    assert [(hole.row, hole.rows) for hole in holes_of(np.delete(t, lost))] == [
        (1, 1),
        (699, 1),
        (700, 1),
        (1997, 1),
        (4994, 1),
    ]


def test_a_recording_with_more_holes_than_rows_is_refused(tmp_path: Path, root: Path) -> None:
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, ((100, 3000),))
    with pytest.raises(InputError, match=r"3000 rows are missing, more than its 750 \(none from 0.396 to 12.400 s\)"):
        filled(recording, holes_of(recording.t))
    assert holes_of(recording.t) == (Hole(100, 3000, pytest.approx(0.396), pytest.approx(12.4)),)


def test_a_link_encoder_at_one_joint_alone_is_filled_there(tmp_path: Path, root: Path) -> None:
    """The other joints' columns have no sample at all: a spline through none ended in a traceback."""
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, LOST)
    link = np.column_stack([recording.q[:, 0], np.full(len(recording.t), np.nan)])
    whole = filled(replace(recording, ql=link), holes_of(recording.t))
    assert whole.ql is not None and len(whole.ql) == 3750
    np.testing.assert_allclose(whole.ql[:, 0], whole.q[:, 0], atol=1e-12)
    assert np.isnan(whole.ql[:, 1]).all()
