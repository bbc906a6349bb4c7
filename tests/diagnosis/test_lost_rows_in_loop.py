"""Rows of currents that were lost, too few to show along the motion: found in closed loop on the same demands.

The plant and its instruments share no code with the finder; currents are moved in time here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_model import Arm
from arm_model.model_file import read_model
from arm_model.servo import fixed_gains
from daq.recording import Recording
from diagnosis.closed_loop.lost_rows import LostInLoop, lost_in_loop
from tests.blind.laboratory import Laboratory
from tests.blind.motions import fourier
from tests.blind.record import MODEL, recorded, truth
from tests.blind.recordings import read_recordings, write_recording

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")

LABORATORY = Laboratory("mixed", route="table")
ROW = 3100
"""After which rows are lost, at 1 kHz."""
Set = tuple[list[Recording], list[Recording]]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Set:
    folder = tmp_path_factory.mktemp("healthy")
    for side, seeds in (("fit", (1,)), ("held_out", (3,))):
        for number, seed in enumerate(seeds):
            rows = recorded(truth(fourier("run", seed, 0.12, 0.9, 6.0), (), LABORATORY), LABORATORY, seed)
            write_recording(folder / f"{side}_{number}.mcap", rows, LABORATORY)
    return read_recordings(folder)


def _found(
    recordings: Set,
    lag: float = 0.0,
    lost: tuple[int, float] = (0, 0),
    joint: int | None = None,
    arm: Arm | None = None,
) -> LostInLoop | None:
    """What is found where currents (of one joint) are ``lag`` s late, and so many rows early from a row on, in all."""
    fit, held_out = recordings
    row, count = lost

    def moved(r: Recording) -> np.ndarray:
        t, rows = r.t - r.t[0], np.arange(len(r.t))
        at = t - lag + np.where(rows >= row, count, 0) * r.dt
        columns = [np.interp(at, t, i) if joint in (None, j) else i for j, i in enumerate(r.i.T, 1)]
        return np.column_stack(columns)

    return lost_in_loop(arm or read_model(MODEL), fit, held_out, [moved(r) for r in (*fit, *held_out)])


@pytest.mark.parametrize(("lag", "count"), [(0.0, 3), (-0.002, 2), (0.001, 5)])
def test_rows_lost_at_an_instant_are_found_beside_any_lag(recordings: Set, lag: float, count: int) -> None:
    found = _found(recordings, lag, (ROW, count))
    assert found is not None and [loss.recording for loss in found.losses] == [0, 1]
    assert {loss.count for loss in found.losses} == {count}
    assert all(abs(loss.row - ROW) < 3 * loss.row_std < 1000 for loss in found.losses)
    assert found.gain.after < found.gain.before and found.gain.p < 0.05


@pytest.mark.parametrize("lag", [0.0, -0.0012, 0.004])
def test_a_lag_throughout_is_no_loss(recordings: Set, lag: float) -> None:
    assert _found(recordings, lag) is None


def test_one_joint_alone_lost_no_rows(recordings: Set) -> None:
    assert _found(recordings, lost=(ROW, 4), joint=2) is None


def test_half_a_row_is_no_loss(recordings: Set) -> None:
    assert _found(recordings, lost=(ROW, 2.5)) is None


def test_servos_that_are_not_the_arm_s_say_nothing(recordings: Set) -> None:
    arm = fixed_gains(read_model(MODEL))
    assert arm.controller is not None and arm.controller.position_gain is not None
    softer = tuple(gain / 2 for gain in arm.controller.position_gain)
    other = replace(arm, controller=replace(arm.controller, position_gain=softer))
    assert _found(recordings, lost=(ROW, 4), arm=other) is None
