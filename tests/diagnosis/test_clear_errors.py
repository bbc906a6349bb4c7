"""Nothing is consistent or explained while the closed loop stands clearly above the noise, in any band."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt

import armscope
from arm_model import parameter, read_model
from arm_model.tables import uncertainty_of
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.closed_loop import model_errors
from diagnosis.closed_loop.clear_errors import LIMITS, SampledLoops, clear_errors
from diagnosis.closed_loop.comparison import LoopComparison, LoopPair
from diagnosis.closed_loop.model_errors import sampled_arms
from diagnosis.closed_loop.oscillation import oscillation, with_oscillations
from diagnosis.closed_loop.setpoint_phase import lag_of
from diagnosis.residual.filters import kept_rows, rate_of
from diagnosis.residual.generation import residual_run
from identification.preprocessing import UNKNOWN, Setpoints
from identification.preprocessing.folding import folded_into
from identification.selection import Split

RATE, NOISE = 500.0, 0.01


def _compared(wrong: np.ndarray, seed: int = 1) -> LoopComparison:
    """20 s of two joints in motion; ``wrong`` (m,) A more current of joint 2 than simulated."""
    t = np.arange(0.0, 20.0, 1 / RATE)
    rng = np.random.default_rng(seed)
    current = NOISE * rng.normal(size=(len(t), 2))
    current[:, 1] += wrong
    still = np.zeros((len(t), 2))
    rows = len(t[kept_rows(rate_of(t))])
    return LoopComparison("a", t, current, still, still + t[:, None], still, np.ones((rows, 2), bool))


def _twice(compared: LoopComparison) -> LoopPair:
    """Without and with causes, of which there are none."""
    return compared, compared


T = np.arange(0.0, 20.0, 1 / RATE)
BELOW = NOISE * np.sqrt(20.0 / (RATE / 2))
"""A: white noise below 20 Hz."""
RUN = cast(Any, SimpleNamespace(loop_noise=np.full(2, BELOW), setpoints=UNKNOWN))
RUNS = Split([RUN], [RUN])


def test_noise_and_a_few_seconds_of_breaking_away_are_nothing() -> None:
    few = 30 * BELOW * np.sin(20 * T) * (T > 15.0)
    compared = Split([_twice(_compared(few))], [_twice(_compared(0.0 * T, 2))])
    assert clear_errors(compared, RUNS, []) == []


@pytest.mark.parametrize("part", ["fit", "held_out"])
@pytest.mark.parametrize(("hertz", "against"), [(5.0, NO_VARIABLE), (47.0, "frequencies of 20 to 100 Hz")])
def test_what_lasts_is_told_with_its_band_and_size(part: str, hertz: float, against: str) -> None:
    noise = [_twice(_compared(0.0 * T, 2))]
    wave = [_twice(_compared(0.1 * np.sin(2 * np.pi * hertz * T)))]
    compared = Split(wave, noise) if part == "fit" else Split(noise, wave)
    (found,) = clear_errors(compared, RUNS, [])
    assert (found.signal, found.joint, found.against) == (Signal.CLOSED_LOOP, 2, against)
    assert "times the noise, in " + {"fit": "fitted", "held_out": "held-out"}[part] in found.size
    assert float(found.size.split()[0]) > max(LIMITS.loop, LIMITS.loop_band)
    assert clear_errors(compared, RUNS, [2]) == []  # reported already


def test_what_sampling_folds_is_no_clear_error(root: Path) -> None:
    """Of two rows per setpoint, what a servo's ripple adds in proportion to the acceleration is not known at all."""
    arm = read_model(root / "config/starters/csv/model.toml")
    assert arm.controller is not None
    arm = replace(arm, controller=replace(arm.controller, setpoint_period=2 / RATE))
    wave = np.sin(2 * np.pi * 0.7 * T)
    one = _compared(20 * BELOW * wave)
    angle = np.round(np.column_stack([wave, wave]) / 1e-6) * 1e-6
    run = residual_run("a", arm, T, angle, one.current)
    folds = replace(one, less_folded=run.less_folded)
    assert clear_errors(Split([_twice(folds)], []), RUNS, []) == []
    assert float(folds.error_rms("current")[1]) < 2 * BELOW
    # what goes with something else stays
    other = replace(_compared(20 * BELOW * np.sin(2 * np.pi * 1.7 * T)), less_folded=run.less_folded)
    for seen in (one, other):
        assert [found.joint for found in clear_errors(Split([_twice(seen)], []), RUNS, [])] == [2]


@pytest.mark.parametrize(("period", "hertz", "told"), [(0.0, 37.5, 1), (1 / 462.5, 37.5, 0), (1 / 462.5, 60.0, 1)])
def test_a_line_of_setpoints_that_is_folded_into_the_band_is_no_clear_error(
    period: float, hertz: float, told: int
) -> None:
    """At 500 rows/s, setpoints at 462.5 Hz are seen at 37.5 Hz, as large as a transducer is at 462.5 Hz."""
    runs = RUNS.map(lambda _: [cast(Any, SimpleNamespace(loop_noise=RUN.loop_noise, setpoints=Setpoints(period)))])
    transients = 0.1 * np.sin(2 * np.pi * 0.5 * T) * np.sin(2 * np.pi * hertz * T)
    found = clear_errors(Split([_twice(_compared(transients))], []), runs, [])
    assert [one.joint for one in found] == [2] * told


@pytest.mark.parametrize("standing", [True, False])
def test_noise_above_20_hz_is_as_large_as_it_is_at_rest(standing: bool) -> None:
    """Correlated over 15 ms it scatters little from row to row, and is no noise if it is not there at rest."""
    sections = butter(2, 15.0, output="sos", fs=RATE)
    slow = sosfilt(sections, np.random.default_rng(3).normal(size=len(T)))
    one = _compared(slow * (standing | (T > 1.0)))
    moving = replace(one, angle=np.clip(one.angle - 1.0, 0.0, None))
    found = clear_errors(Split([_twice(moving)], []), RUNS, [])
    assert ("frequencies of 20 to 100 Hz" in [error.against for error in found]) is not standing


@pytest.mark.parametrize(
    ("period", "rate", "hertz"), [(0.004, 800.0, [50.0]), (0.028, 2000.0, []), (0.01, 1000.0, []), (0.0, 500.0, [])]
)
def test_folded_lines_in_the_band(period: float, rate: float, hertz: list[float]) -> None:
    """Where they are seen at lines below half of the rate, what is seen there is these as well."""
    np.testing.assert_allclose(folded_into((20.0, 100.0), period, rate), hertz)


@pytest.mark.parametrize("hertz", [5.0, 47.0])
def test_what_the_model_may_be_off_by_is_no_clear_error(hertz: float) -> None:
    """Loops of arms that the model may be: as far from its own as the error, or a tenth of that."""
    wave = 0.1 * np.sin(2 * np.pi * hertz * T)
    compared = RUNS.map(lambda _: [_twice(_compared(wave))])
    for share, told in ((1.0, 0), (0.1, 1)):
        sampled_arms = [_compared(share * k * wave, seed=k + 2) for k in (-1, 1)]
        quiet = [[replace(one, current=one.current * [0.0, 1.0])] for one in sampled_arms]
        drawn: SampledLoops = partial(list, quiet)
        assert len(clear_errors(compared, RUNS, [], Split(drawn, drawn))) == told


def test_arms_are_drawn_as_the_model_says(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_errors, "DRAWS", 500)
    arm = read_model(root / "config/starters/csv/model.toml")
    names = ("joint1.coulomb", "link2.mx")
    covariance = np.array([[0.04, 0.01], [0.01, 0.0225]])
    assert sampled_arms(arm) == []
    several = sampled_arms(replace(arm, uncertainty=uncertainty_of("model_uncertainty.json", names, covariance)))
    values = np.array([[parameter(one, name) for name in names] for one in several])
    np.testing.assert_allclose(values.mean(axis=0), [parameter(arm, name) for name in names], atol=0.03)
    np.testing.assert_allclose(np.cov(values.T), covariance, atol=0.006)


@settings(max_examples=10)
@given(lag=st.floats(-0.019, 0.019), seed=st.integers(0, 99))
def test_lag_between_currents_of_the_band(lag: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hertz, phase = rng.uniform(20.0, 100.0, (200, 2)), rng.uniform(0.0, 2 * np.pi, (200, 2))

    def current(t: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * hertz * t[:, None, None] + phase).sum(axis=1)

    t = T[:3000]
    assert lag_of(current(t - lag), current(t), RATE) == pytest.approx(lag, abs=1e-4)


def test_a_joint_that_swings_does_not_decide_the_lag_of_the_others() -> None:
    """Its currents, ten times as large, are behind by 9 ms more than those of the other two."""
    t, rng = T[:3000], np.random.default_rng(1)

    def current(t: np.ndarray, hertz: np.ndarray, phase: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * hertz * t[:, None, None] + phase).sum(axis=1)

    others = rng.uniform(20.0, 100.0, (200, 2)), rng.uniform(0.0, 2 * np.pi, (200, 2))
    swing = np.full((1, 1), 23.0), np.zeros((1, 1))
    measured = np.hstack([current(t - 1e-3, *others), 100.0 * current(t - 10e-3, *swing)])
    simulated = np.hstack([current(t, *others), 60.0 * current(t, *swing)])
    assert lag_of(measured, simulated, RATE) == pytest.approx(1e-3, abs=1e-4)


def _transients(t: np.ndarray) -> np.ndarray:
    """(m, 2) every 28 ms, of random sizes, that ring at 60 Hz."""
    sizes, total = np.random.default_rng(3).normal(size=(2000, 2)), np.zeros((len(t), 2))
    for k in range(round(t[-1] / 0.028) + 2):
        since = np.maximum(t - 0.028 * k, 0.0)
        total += sizes[k] * (np.exp(-since / 0.005) * np.sin(2 * np.pi * 60.0 * since))[:, None]
    return total


def _noisy(measured: np.ndarray, simulated: np.ndarray) -> LoopComparison:
    noise = NOISE * np.random.default_rng(5).normal(size=(len(T), 2))
    still, known = np.zeros((len(T), 2)), np.ones((len(T[kept_rows(rate_of(T))]), 2), bool)
    return LoopComparison("a", T, measured + noise, simulated, still + T[:, None], still, known)


@pytest.mark.parametrize("lag", [-0.0135, -1e-3, 0.0, 0.4e-3, 7.7e-3])
def test_setpoints_at_other_instants_are_no_error(lag: float) -> None:
    """Transients are simulated, and measured later by ``lag``."""
    measured, simulated = _transients(T - lag), _transients(T)
    found = clear_errors(Split([_twice(_noisy(measured, simulated))], []), RUNS, [])
    assert [one for one in found if "20" in one.against] == []
    found = clear_errors(Split([_twice(_noisy(measured, 0.6 * simulated))], []), RUNS, [])
    assert {one.joint for one in found if "20" in one.against} == {1, 2}


def test_cogging_stays_with_the_angles_where_setpoints_come_later() -> None:
    """It was moved with the transients: a SCARA whose cogging is known exactly was left at 4.9 times the noise."""
    cogging = np.column_stack([0.0 * T, 0.3 * np.sin(2 * np.pi * 45.0 * T + np.sin(T))])
    measured, without = _transients(T - 1e-3) + cogging, _noisy(_transients(T), _transients(T))
    pair = without, _noisy(measured, _transients(T) + cogging)
    found = clear_errors(Split([pair], []), RUNS, [])
    assert [one for one in found if "20" in one.against] == []
    wrong = without, _noisy(measured, _transients(T) + 0.6 * cogging)
    found = clear_errors(Split([wrong], []), RUNS, [])
    assert {one.joint for one in found if "20" in one.against} == {2}


def test_a_current_that_oscillates_at_47_hz_is_not_consistent(root: Path, tmp_path: Path) -> None:
    arm = armscope.read_model(root / "config/starters/csv/model.toml")

    def recorded(name: str) -> Recording:
        motion = armscope.simulate(arm, armscope.read_experiment(root / f"config/starters/csv/{name}.toml"))
        clean = motion.write(tmp_path / f"clean_{name}.mcap")
        assert clean.qref is not None
        current = clean.i + 0.01 * np.random.default_rng(4).normal(size=clean.i.shape)
        current[:, 1] += 0.1 * np.sin(2 * np.pi * 47.0 * clean.t)
        write_table(tmp_path / f"{name}.mcap", clean.t, {"q": clean.q, "i": current, "qref": clean.qref}, Attachments())
        return open_recording(tmp_path / f"{name}.mcap")

    result = armscope.diagnose(recorded("fit"), arm, held_out=recorded("held_out"))
    assert result.verdict == "unexplained"
    assert {(one.joint, one.signal) for one in result.details.unexplained} == {(2, Signal.CLOSED_LOOP)}
    assert "the current in closed loop of joint 2 against frequencies of 20 to 100 Hz" in str(result)
    assert "loop_band" in result.to_json()["limits"]["verdict"]
    assert "it oscillates at 47.0 Hz, with an amplitude of 100 mA, and the angle does not" in str(result)


@pytest.mark.parametrize("frequency", [5.3, 38.0])
def test_a_servo_that_oscillates_is_told_with_frequency_and_amplitudes(frequency: float) -> None:
    """A relay's rectangular current, and the angle that it moves: the first harmonic of a rectangle is 4 / pi of it."""
    phase = 2 * np.pi * frequency * T + 0.3 * np.cumsum(np.random.default_rng(2).normal(size=len(T))) / np.sqrt(RATE)
    one = _compared(0.2 * np.sign(np.sin(phase)))
    angle = one.angle + np.column_stack([0.0 * T, 1e-3 * np.sin(phase)])
    band = (2.0, 20.0) if frequency < 20.0 else (20.0, 100.0)
    found = oscillation([replace(one, angle=angle)] * 2, 2, band)
    assert found is not None
    assert abs(found.frequency - frequency) < 0.1
    assert found.current == pytest.approx(0.2 * 4 / np.pi, rel=0.1) and found.angle == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize(("frequency", "told"), [(50.0, "once the rate"), (100.0, "2 times the rate"), (38.0, "")])
def test_what_a_servo_does_at_setpoints_is_no_oscillation(root: Path, frequency: float, told: str) -> None:
    arm = armscope.read_model(root / "config/starters/csv/model.toml")
    assert arm.controller is not None
    arm = replace(arm, controller=replace(arm.controller, setpoint_period=0.02))
    left = Structure(Signal.CLOSED_LOOP, 2, "frequencies of 20 to 100 Hz", 0.0, "4.8 times the noise")
    seen = _compared(0.1 * np.sin(2 * np.pi * frequency * T))
    (one,) = with_oscillations([left], [seen], arm)
    assert ("it oscillates" in one.size) != bool(told)
    assert told in one.size


def test_a_line_that_only_the_simulation_has_is_no_fault_of_the_servo(root: Path) -> None:
    """The model sends setpoints every 20 ms, the arm gets others: elasticity and gains were to be checked."""
    arm = armscope.read_model(root / "config/starters/csv/model.toml")
    assert arm.controller is not None
    arm = replace(arm, controller=replace(arm.controller, setpoint_period=0.02))
    left = Structure(Signal.CLOSED_LOOP, 2, "frequencies of 20 to 100 Hz", 0.0, "4.8 times the noise")
    seen, line = _compared(0.0 * T), 0.1 * np.sin(2 * np.pi * 50.0 * T)
    (one,) = with_oscillations([left], [replace(seen, simulated_current=np.column_stack([0.0 * T, line]))], arm)
    assert "that the measured current lacks" in one.size and "correct the controller" in one.size
    assert "elasticity" not in one.size


def test_noise_and_breaking_away_do_not_oscillate() -> None:
    for wrong in (0.0 * T, 30 * BELOW * (T > 15.0), BELOW * np.cumsum(np.random.default_rng(3).normal(size=len(T)))):
        for band in ((2.0, 20.0), (20.0, 100.0)):
            assert oscillation([_compared(wrong)], 2, band) is None
