"""Rows that the counter of one joint lost, several times in a recording of an independent plant.

The losses are cut out of the recorded column by numpy: all other channels go on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_io.types import Array
from arm_model.model_file import read_model
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.cause import LostRows
from diagnosis.diagnose import diagnose
from diagnosis.report.text import diagnosis_text
from diagnosis.report.write import table_of
from diagnosis.screening.cleaned import screened
from diagnosis.screening.event import Event, Gain, united
from diagnosis.screening.lost_rows.counter_gaps import CounterGap, put_back
from tests.blind.hide import Hidden
from tests.blind.laboratory import Laboratory
from tests.blind.motions import fourier
from tests.blind.record import MODEL, recorded, truth

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")

LABORATORY = Laboratory("singles")
ARM = read_model(MODEL)
LOST = ((2500, 12), (5000, 27), (8200, 8))
"""Rows by the other channels, and how many of them the counter lost."""
PAYLOAD = Hidden("payload", None, {"mass": 2.0, "x": 0.0, "y": 0.0, "z": 0.05})
FRICTION = Hidden("coulomb_friction", 2, {"coulomb": 6.0})
SPRING = Hidden("gravity_spring", 2, {"stiffness": 15.0, "rest_angle": -1.0})
"""What a taut cable does."""


RECORDED: dict[str, tuple[Array, Array, Array]] = {}


def _rows(hidden: tuple[Hidden, ...], seed: int) -> tuple[Array, Array, Array]:
    """t (m,) s, q (m, 6) rad, i (m, 6) A; each recorded once."""
    key = f"{hidden}, {seed}"
    if key not in RECORDED:
        what = truth(fourier("run", seed, 0.12, 0.9, 10.0), hidden, LABORATORY)
        rows = recorded(what, LABORATORY, seed)
        RECORDED[key] = what.signals.t, rows.q, rows.i
    return RECORDED[key]


def _recording(
    path: Path, *hidden: Hidden, joint: int = 2, lost: tuple[tuple[int, int], ...] = (), seed: int = 3
) -> Recording:
    t, q, i = _rows(hidden, seed)
    missing = [row + k for row, count in lost for k in range(count)]
    kept = np.delete(q[:, joint - 1], missing)
    rows = len(kept)
    q = q[:rows].copy()
    q[:, joint - 1] = kept
    write_table(path, t[:rows], {"q": q, "i": i[:rows]}, Attachments())
    return open_recording(path)


def _events(recording: Recording) -> list[Event]:
    return screened(ARM, [recording]).events


def _check(found: tuple[LostRows, ...], joint: int, lost: tuple[tuple[int, int], ...]) -> None:
    assert len(found) == len(lost)
    before = 0
    for one, (row, count) in zip(found, lost):
        assert one.joint == joint
        assert one.row == row - before
        assert abs(one.count + count) <= 2
        assert abs(one.time - row * 1e-3) < 0.004
        before += count


@pytest.mark.parametrize("joint", [2, *(pytest.param(j, marks=pytest.mark.slow) for j in (1, 5, 6))])
def test_rows_that_one_counter_lost_several_times_are_found(joint: int, tmp_path: Path) -> None:
    recording = _recording(tmp_path / "a.mcap", joint=joint, lost=LOST)
    (event,) = _events(recording)
    assert (event.effect, event.joint, list(event.of_joints)) == ("dropped_trigger", None, [joint])
    _check(event.lost_rows, joint, LOST)
    assert event.gain is not None and event.gain.joint == joint and event.gain.after < 0.3 * event.gain.before


@pytest.mark.parametrize(
    "hidden", [PAYLOAD, pytest.param(FRICTION, marks=pytest.mark.slow), pytest.param(SPRING, marks=pytest.mark.slow)]
)
def test_no_loss_is_found_where_something_else_is_wrong_and_losses_are_found_beside_it(
    hidden: Hidden, tmp_path: Path
) -> None:
    assert _events(_recording(tmp_path / "whole.mcap", hidden)) == []
    (event,) = _events(_recording(tmp_path / "lost.mcap", hidden, lost=LOST))
    _check(event.lost_rows, 2, LOST)


@pytest.mark.parametrize("seed", [3, 4, *(pytest.param(s, marks=pytest.mark.slow) for s in (5, 6, 7))])
def test_a_healthy_recording_has_no_losses(seed: int, tmp_path: Path) -> None:
    assert _events(_recording(tmp_path / "a.mcap", seed=seed)) == []


def test_missed_counts_in_the_direction_of_motion_are_no_lost_rows(tmp_path: Path) -> None:
    missed = Hidden("missed_counts", 5, {"counts": 60, "time": 5.0, "resolution": 8.736e-5})
    (event,) = _events(_recording(tmp_path / "a.mcap", missed))
    assert (event.effect, event.joint, event.lost_rows) == ("missed_counts", 5, ())


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "lost"), [(1, ((2000, 90), (7000, 10))), (5, ((3100, 140), (6500, 60)))])
def test_long_losses_are_counted_by_the_current(joint: int, lost: tuple[tuple[int, int], ...], tmp_path: Path) -> None:
    (event,) = _events(_recording(tmp_path / "a.mcap", joint=joint, lost=lost))
    _check(event.lost_rows, joint, lost)


def test_angles_are_put_back_where_they_belong() -> None:
    t = 1e-3 * np.arange(4000)
    true = np.column_stack([np.sin(1.3 * t), 0.7 * np.cos(0.9 * t)])
    kept = np.delete(true[:, 0], [*range(1000, 1020), *range(2500, 2540)])
    seen = np.column_stack([kept, true[: len(kept), 1]])
    gaps = [
        CounterGap(joint=1, row=1000, lost=20, time=1.0),
        CounterGap(joint=1, row=2480, lost=40, time=2.5),
    ]
    found = put_back(seen, gaps)
    np.testing.assert_allclose(found, true[: len(kept)], atol=2e-6)
    np.testing.assert_array_equal(put_back(seen, []), seen)


def test_events_of_one_effect_are_one_event() -> None:
    lost = [LostRows(file="a", joint=j, row=10 * k, time=0.01 * k, count=-3) for k, j in enumerate((2, None))]
    both = [
        Event(
            effect="dropped_trigger",
            joint=None,
            parameters=[],
            evidence=f"{k}",
            recordings=(k,),
            gain=Gain(before=2.0 + k, after=1.0, unit="A", joint=2) if k else None,
            lost_rows=(one,),
        )
        for k, one in enumerate(lost)
    ]
    (event,) = united(both)
    assert (event.evidence, event.recordings, event.lost_rows) == ("0; 1", (0, 1), tuple(lost))
    assert event.gain == both[1].gain


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_diagnosis_names_every_loss_with_row_and_time(tmp_path: Path) -> None:
    runs = [_recording(tmp_path / "a.mcap", lost=LOST), _recording(tmp_path / "b.mcap", seed=4)]
    result = diagnose(ARM, runs[:1], runs[1:])
    (cause,) = result.causes
    assert (result.verdict, cause.key) == ("explained", ("dropped_trigger", None))
    _check(cause.lost_rows, 2, LOST)
    table = table_of(result, runs[:1], runs[1:])
    assert [one["row"] for one in table["causes"][0]["lost_rows"]] == [one.row for one in cause.lost_rows]
    assert "counter of joint 2: 12 rows before row 2500 (2.500 s) of a.mcap" in diagnosis_text(result, table)
    assert table["origins"][0]["origin"] == "counter_of_joint"
    joints = {row["joint"]: row["noise_ratio"]["after"] for row in table["signals"] if "noise_ratio" in row}
    assert max(joints.values()) < 1.3
