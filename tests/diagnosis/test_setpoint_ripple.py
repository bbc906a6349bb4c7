"""What servos do at setpoints is neither noise nor structure, at any ratio of the rates of rows and setpoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

import armscope
from arm_model import Arm, EffectTerm
from arm_model.sensing import recorded
from arm_model.simulation import simulate_at
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.measurements.currents.columns import columns
from diagnosis.residual.filters import COMPARE_BAND, kept_rows, low_pass, motion_of
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import scatter
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import known_setpoints
from diagnosis.residual.setpoint_ripple import folded_onto
from diagnosis.selection.candidate import Candidate
from identification.preprocessing import Driven, Setpoints
from identification.preprocessing.spectrum import choose_band

NOISE, STEP = 0.01, 1.5e-6
Sample = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    """Two links with a setpoint every 10 ms, as of a simulated fleet."""
    return armscope.read_model(root / "config/models/two_link.toml")


def _sampled(arm: Arm, rate: float, number: int = 0, seconds: float = 10.0) -> Sample:
    """t (m,) s; q (m, 2) rad, i (m, 2) A and setpoints (m, 2) rad as straight lines, at ``rate`` rows/s."""
    t, phase = np.arange(int(seconds * rate)) / rate, np.random.default_rng(number).uniform(0, 6, (2, 3))
    turns = 2 * np.pi * np.outer(np.arange(int(100 * seconds) + 2) / 100, [0.17, 0.47, 1.3])
    begun = np.minimum(np.arange(len(turns)) / 150, 1.0)[:, None]
    begun = begun**3 * (10 - 15 * begun + 6 * begun**2)
    plan = begun * np.stack([np.sin(turns + one) @ np.array([0.5, 0.28, 0.08]) for one in phase], axis=1)
    knots = np.arange(len(turns)) / 100

    def demand(times: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(times, knots, one) for one in plan.T])

    motion = simulate_at(arm, demand, t)
    shown, noise = recorded(arm, motion), np.random.default_rng([number, 1]).standard_normal((len(t), 2))
    return t, np.round(shown.q / STEP) * STEP, shown.current + NOISE * noise, demand(t)


@pytest.mark.parametrize("rate", [200.0, 240.0, 250.0, 333.0, 500.0])
def test_a_healthy_arm_is_left_at_the_true_noise(arm: Arm, rate: float) -> None:
    """The fifth line of the setpoints falls onto 0 Hz at 250 and 500 rows/s, to 20 Hz at 240, all lines do at 200."""
    t, q, i, _ = _sampled(arm, rate)
    run = residual_run("healthy", arm, t, q, i)
    frequency = np.linspace(0.0, rate / 2, 2000)
    share = np.trapezoid(1.0 / (1.0 + (frequency / COMPARE_BAND) ** 8) ** 2, frequency) / (rate / 2)
    assert run.noise == pytest.approx(NOISE * np.sqrt(share), rel=0.25)
    assert scatter(i)[0] > 6 * NOISE  # what their lines would have counted as
    left = np.sqrt(np.mean(run.whitened**2, axis=0))
    assert np.all((left > 0.6) & (left < 1.2))


def test_the_ripple_beside_zero_counts_for_little(arm: Arm) -> None:
    """At 240 rows/s the fifth line, an oscillation of 20 Hz, is twice the noise."""
    t, q, i, _ = _sampled(arm, 240.0)
    run = residual_run("healthy", arm, t, q, i)
    rms: Callable[[Run], float] = lambda one: float(np.sqrt(np.mean(one.whitened[:, 0] ** 2)))  # noqa: E731
    assert rms(run) < 1.2 < 1.7 < rms(replace(run, rippled=np.zeros_like(run.rippled)))
    assert np.all(run.hidden_in(run.residual / run.deviation)[:, 1] != 0.0)


@pytest.mark.parametrize("rate", [240.0, 250.0, 1000.0])
def test_a_clock_that_is_millionths_off_changes_no_bound(arm: Arm, rate: float) -> None:
    """Lines that sampling shows at one frequency are then some mHz apart, and still one line."""
    t, q, i, _ = _sampled(arm, rate)
    exact, off = (residual_run("healthy", arm, t * clock, q, i) for clock in (1.0, 1.000005))
    of_clock = lambda run: np.concatenate([run.folded, run.rippled.reshape(len(run.t), -1)], axis=1)  # noqa: E731
    bound = np.sqrt(np.mean(of_clock(exact) ** 2, axis=0))
    assert bound.max() > 0.001
    assert np.sqrt(np.mean(of_clock(off) ** 2, axis=0)) == pytest.approx(bound, rel=0.02, abs=1e-4)


@pytest.fixture
def recordings(arm: Arm, tmp_path: Path) -> Callable[..., list[Recording]]:
    def record(*effects: EffectTerm, rate: float = 250.0) -> list[Recording]:
        worn, found = replace(arm, effects=effects), []
        for number in range(2):
            t, q, i, qref = _sampled(worn, rate, number)
            path = tmp_path / f"{number}.mcap"
            write_table(path, t, {"q": q, "i": i, "qref": qref}, Attachments())
            found.append(open_recording(path))
        return found

    return record


def test_of_setpoints_every_one_and_a_quarter_rows_no_body_is_named(
    arm: Arm, recordings: Callable[..., list[Recording]]
) -> None:
    """At 125 rows/s the fifth line falls onto 0 Hz: a payload of 0.2 kg was named."""
    fit, held_out = recordings(rate=125.0)
    assert armscope.diagnose(fit, arm, held_out=held_out).verdict == "consistent"


def test_small_viscous_friction_is_no_current_gain(arm: Arm, recordings: Callable[..., list[Recording]]) -> None:
    """Setpoints every 10 ms and 250 rows/s: with the servos' lines for noise, a gain of the current was named."""
    fit, held_out = recordings(EffectTerm("viscous_friction", 1, {"viscous": 0.3}))
    found = armscope.diagnose(fit, arm, held_out=held_out)
    assert [(one.effect, one.joint) for one in found.causes] == [("viscous_friction", 1)]
    viscous = found.causes[0].parameters[0]
    assert found.verdict == "explained" and abs(viscous.value - 0.3) < 2 * viscous.std < 0.05


@pytest.mark.parametrize(("half_gap", "rate"), [(1e-3, 250.0), (5e-3, 250.0), (2e-3, 125.0)])
def test_a_gap_is_its_size_and_no_time_skew(
    arm: Arm, recordings: Callable[..., list[Recording]], half_gap: float, rate: float
) -> None:
    """250 rows/s of which every second one is kept, 125 and not 100 a second: named 1.3 mrad and a skew of 2 ms.

    Of larger gaps, what folds of the setpoints was named an inertia: teeth that meet looked like noise above it.
    """
    fit, held_out = recordings(EffectTerm("backlash", 1, {"half_gap": half_gap}), rate=rate)
    found = armscope.diagnose(fit, arm, held_out=held_out)
    assert [(one.effect, one.joint) for one in found.causes] == [("backlash", 1)]
    assert found.verdict == "explained"
    assert found.causes[0].parameters[0].value == pytest.approx(half_gap, rel=0.05)


@pytest.mark.parametrize(("half_gap", "step"), [(0.0, 1e-4), (1e-3, 1.5e-6)])
def test_a_motion_of_a_few_waves_is_no_motion_of_the_slowest(arm: Arm, half_gap: float, step: float) -> None:
    """Between waves of 0.47 and 1.3 Hz is less power than before the noise: motion was said to end at 0.9 Hz."""
    worn = replace(arm, effects=(EffectTerm("backlash", 1, {"half_gap": half_gap}),) if half_gap else ())
    q = _sampled(worn, 250.0, 1)[1]
    assert choose_band(np.round(q / step) * step, 1.0 / 250.0).parallel > 1.3


def test_rows_that_are_kept_have_the_rate_that_they_have(arm: Arm) -> None:
    """A spring behind the motor, and a rate of change, at 250 rows/s as at 500."""
    springs = Candidate("joint_compliance", 1, (("stiffness", 2e3), ("damping", 20.0)))
    found = []
    for rate in (250.0, 500.0):
        t, q, i, _ = _sampled(arm, rate)
        run = residual_run("healthy", arm, t, q, i)
        assert run.rate(np.sin(9 * run.t)) == pytest.approx(9 * np.cos(9 * run.t), abs=0.05)
        found.append(np.interp(np.arange(1.0, 8.0, 0.01), run.t, columns(springs, run)[:, 0, 0]))
    assert np.std(found[0] - found[1]) < 0.05 * np.std(found[1])


def test_a_model_without_controller_learns_of_the_setpoints_from_the_demands(
    arm: Arm, recordings: Callable[..., list[Recording]]
) -> None:
    fit, held_out = recordings()
    bare = replace(arm, controller=None)
    assert known_setpoints(bare, fit).period == pytest.approx(0.01, rel=1e-4)
    assert known_setpoints(bare, replace(fit, qref=None)).period == 0.0
    found = armscope.diagnose(fit, bare, held_out=held_out)
    assert found.verdict == "consistent"
    assert found.details.fit[0].noise[0] < 0.01
    assert any("250 Hz is 2.5 times the rate" in one for one in found.details.warnings)


def test_what_folds_follows_steps_of_the_acceleration_as_quickly_as_the_residual(arm: Arm) -> None:
    """Of a motion slower than 13 Hz, what folds was, too: at steps of the acceleration it left ten times the noise."""
    rate, period = 250.0, 0.02
    t, corners = np.arange(0.0, 12.0, 1.0 / rate), np.arange(0.0, 12.1, period)
    asked = np.array([8.0, -8.0, -8.0, 8.0, 0.0])[np.arange(len(corners)) // 12 % 5]
    demand = np.tile(np.interp(t, corners, np.cumsum(np.cumsum(asked)) * period**2)[:, None], (1, len(arm)))
    q = signal.sosfilt(signal.butter(2, 12.0, output="sos", fs=rate), demand, axis=0)
    bends = np.diff(demand, 2, axis=0, prepend=demand[:1], append=demand[-1:]) * rate**2
    expected, seen = low_pass(bends, COMPARE_BAND, rate), np.cos(2 * np.pi / period * t + 0.3)[:, None]
    acceleration, kept = motion_of(q, COMPARE_BAND, rate)[2], kept_rows(rate)
    current = 0.5 * acceleration + 0.05 * expected * seen
    known = Setpoints(period, "demands")
    driven = Driven(t, current * arm.joint_array("drive_constant"), known, demand, COMPARE_BAND)
    folded = folded_onto(arm, q, driven, acceleration[kept], kept)
    for got, want in zip(folded.T, expected[kept].T):
        assert want @ got > 0.0
        assert np.sum((got - want * (want @ got) / (want @ want)) ** 2) < 1e-3 * np.sum(got**2)
