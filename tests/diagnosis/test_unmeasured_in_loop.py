"""Rows without a sample have no error in closed loop: what was interpolated there lacks all that the loop does.

Currents that were repeated for 0.4 s, flagged so by their instrument, were 4.2 times the noise from 20 to 100 Hz.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from diagnosis.cause import Signal
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import LoopComparison, compare
from diagnosis.closed_loop.oscillation import oscillation
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import scatter
from diagnosis.screening.lost_rows.unmeasured_rows import SMEARED, without_weight
from drivers.protocols import Quality
from identification.selection import Split
from tests.diagnosis.test_blank_samples import _flagged
from tests.diagnosis.test_clear_errors import NOISE, RUNS, _compared, _transients, _twice

T = np.arange(0.0, 20.0, 0.002)
HOLDS = tuple((k + 0.3, k + 0.7) for k in range(20))
HELD = np.any([(start < T) & (end > T) for start, end in HOLDS], axis=0)
SPANS = tuple((start, end, 2) for start, end in HOLDS)
ABOVE = "frequencies of 20 to 100 Hz"


def _found(one: LoopComparison) -> list[tuple[int | None, str]]:
    return [(found.joint, found.against) for found in clear_errors(Split([_twice(one)], []), RUNS, [])]


def test_an_error_in_rows_that_were_not_measured_is_none() -> None:
    one = _compared(0.3 * np.sin(2 * np.pi * 47.0 * T) * HELD)
    assert (2, ABOVE) in _found(one)
    assert _found(replace(one, unmeasured=SPANS)) == []


@pytest.mark.parametrize("frequency", [5.3, 47.0])
def test_an_error_beside_them_keeps_its_size(frequency: float) -> None:
    whole = _compared(0.1 * np.sin(2 * np.pi * frequency * T))
    partly = replace(whole, unmeasured=SPANS[::3])
    band = (2.0, 20.0) if frequency < 20.0 else (20.0, 100.0)
    for one in (whole, partly):
        assert len(_found(one)) == 1
        found = oscillation([one], 2, band)
        assert found is not None and abs(found.frequency - frequency) < 0.1
        assert found.current == pytest.approx(0.1, rel=0.1)
    power = [one.spectrum("current", 1, 2000)[1] for one in (_compared(0.0 * T), _all_lost(_compared(0.0 * T)))]
    assert power[1].mean() == pytest.approx(power[0].mean(), rel=0.1) == pytest.approx(NOISE**2 / 250.0, rel=0.1)


def _all_lost(one: LoopComparison) -> LoopComparison:
    """Without the samples of any channel in the holds."""
    return replace(one, unmeasured=tuple((start, end, None) for start, end in HOLDS))


@pytest.mark.parametrize("lag", [-0.0135, 7.7e-3])
def test_setpoints_at_other_instants_are_no_error_beside_them(lag: float) -> None:
    noise = NOISE * np.random.default_rng(5).normal(size=(len(T), 2))
    measured = np.where(HELD[:, None], 0.0, _transients(T - lag) + noise)
    one = replace(_compared(0.0 * T), current=measured, simulated_current=_transients(T))
    assert {ABOVE} <= {against for _, against in _found(one)}
    assert ABOVE not in {against for _, against in _found(_all_lost(one))}


def test_interpolated_rows_do_not_make_the_noise_of_a_row_smaller() -> None:
    noise = np.random.default_rng(6).normal(size=(len(T), 2))
    some = np.where(np.sin(0.4 * T) > -0.2, 0.0, 1.0)[:, None] * noise
    measured = some != 0.0
    assert np.all(scatter(some) < 0.2)
    assert scatter(some, measured) == pytest.approx([1.0, 1.0], rel=0.1)
    assert np.array_equal(scatter(noise, np.zeros_like(measured)), scatter(noise))


@pytest.fixture(scope="module")
def arm(root: Path) -> armscope.Arm:
    """The starter's, with a setpoint every 28 ms."""
    arm = armscope.read_model(root / "config/starters/csv/model.toml")
    assert arm.controller is not None
    return replace(arm, controller=replace(arm.controller, setpoint_period=0.028))


@pytest.fixture(scope="module")
def recording(arm: armscope.Arm, root: Path, tmp_path_factory: pytest.TempPathFactory) -> armscope.Recording:
    """Its motion by this model, with white noise of the currents."""
    motion = armscope.simulate(arm, armscope.read_experiment(root / "config/starters/csv/fit.toml"))
    clean = motion.write(tmp_path_factory.mktemp("clean") / "run.mcap")
    return replace(clean, i=clean.i + NOISE * np.random.default_rng(4).normal(size=clean.i.shape))


def test_rows_of_no_weight_have_no_error_of_their_signal(arm: armscope.Arm, recording: armscope.Recording) -> None:
    run = residual_run("a", arm, recording.t, recording.q, recording.i)
    run = without_weight(without_weight(run, [(4.0, 4.4)], 2), [(7.0, 7.1)])
    one = compare(recording, arm, run)
    assert one is not None
    current, angle = (one.difference(signal) == 0.0 for signal in ("current", "angle"))
    since = recording.t - recording.t[0]
    held, lost = ((since > start - SMEARED) & (since < end + SMEARED) for start, end in ((4.0, 4.4), (7.0, 7.1)))
    np.testing.assert_array_equal(current, np.column_stack([lost, held | lost]))
    assert angle[lost].all() and not one.measured("angle")[lost].any() and one.measured("angle")[~lost].all()


def test_held_currents_that_are_flagged_are_consistent_in_closed_loop(
    arm: armscope.Arm, recording: armscope.Recording
) -> None:
    """Of a second 0.4 s, as the reviewer's rig of four joints."""
    i, rows = recording.i.copy(), []
    for start in range(200, len(i) - 400, 500):
        i[start : start + 200, 1] = i[start, 1]
        rows += range(start, start + 200)
    held = _flagged(replace(recording, i=i), "i2", rows, Quality.STALE)
    found = armscope.diagnose(held, arm)
    assert found.verdict == "consistent"
    assert [one for one in found.details.unexplained if one.signal is Signal.CLOSED_LOOP] == []
