"""Springs and play found in closed loop, in recordings of a plant that shares no code with the finder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from arm_model import Arm
from arm_model.model_file import read_model
from arm_model.servo import fixed_gains, servo_gains
from daq.recording import Recording
from diagnosis import diagnose
from diagnosis.cause import Cause, Estimate
from diagnosis.closed_loop import resonance
from diagnosis.closed_loop.loop_errors import loop_errors
from diagnosis.closed_loop.resonance import _at_few_joints, transmission_resonance
from diagnosis.closed_loop.servo_gains import with_servo_gains
from diagnosis.outside_selection import resonance_in_loop
from identification.selection import Split
from tests.blind.hide import Hidden
from tests.blind.laboratory import Laboratory
from tests.blind.motions import fourier
from tests.blind.record import MODEL, recorded, truth
from tests.blind.recordings import read_recordings, write_recording

LABORATORY = Laboratory("mixed", route="table")


def _recordings(
    folder: Path, hidden: tuple[Hidden, ...], laboratory: Laboratory = LABORATORY, seconds: float = 8.0
) -> tuple[list[Recording], list[Recording]]:
    for side, seeds in (("fit", (1, 2)), ("held_out", (3,))):
        for number, seed in enumerate(seeds):
            motion = fourier("run", seed, 0.12, 0.9, seconds)
            rows = recorded(truth(motion, hidden, laboratory), laboratory, seed)
            write_recording(folder / f"{side}_{number}.mcap", rows, laboratory)
    return read_recordings(folder)


@pytest.mark.slow
def test_a_spring_too_fast_for_the_currents_along_the_motion(tmp_path: Path) -> None:
    """8000 N m/rad behind the elbow: 25 Hz, above the band in which encoder steps leave anything to be seen."""
    fit, held_out = _recordings(tmp_path, (Hidden("joint_compliance", 3, {"stiffness": 8000.0, "damping": 8.0}),))

    cause = transmission_resonance(read_model(MODEL), fit, held_out, range(1, 7))

    assert cause is not None and (cause.effect, cause.joint) == ("joint_compliance", 3)
    stiffness, damping = cause.parameters
    assert abs(stiffness.value - 8000.0) < 2 * stiffness.std < 1000.0
    assert abs(damping.value - 8.0) < 3.0
    assert cause.after < cause.before / 3


def test_stiff_joints_do_not_swing(tmp_path: Path) -> None:
    fit, held_out = _recordings(tmp_path, ())
    assert transmission_resonance(read_model(MODEL), fit, held_out, range(1, 7)) is None


def test_gains_of_the_servos_are_those_that_the_recordings_show(tmp_path: Path) -> None:
    """Position gains 1.5 times the model's, velocity gains 1.5 ** 0.5 times; one recording of 3 s."""
    laboratory = replace(LABORATORY, gains=1.5)
    motion = fourier("run", 1, 0.12, 0.9, 3.0)
    write_recording(tmp_path / "fit_0.mcap", recorded(truth(motion, (), laboratory), laboratory, 1), laboratory)
    (recording,), _ = read_recordings(tmp_path)
    arm = read_model(MODEL)

    found, own = servo_gains(with_servo_gains(arm, [recording])), servo_gains(arm)

    np.testing.assert_allclose(found.position / own.position, 1.5, rtol=0.1)
    np.testing.assert_allclose(found.velocity / own.velocity, 1.5**0.5, rtol=0.05)


@pytest.mark.parametrize(("times", "is_a_servo_of_the_arm"), [(3.5, True), (0.3, True), (4.5, False), (0.2, False)])
def test_gains_of_more_than_four_times_are_of_another_servo(
    times: float, is_a_servo_of_the_arm: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = fixed_gains(read_model(MODEL))
    own = servo_gains(arm)

    def error(loop: tuple[Arm, Any]) -> np.ndarray:
        """(2, n): how far the logarithm of either gain is from that of the recordings."""
        gains = servo_gains(loop[0])
        ratios = np.stack([gains.position / own.position, gains.velocity / own.velocity])
        return np.log(ratios) - np.log([[times], [1.0]])

    monkeypatch.setattr("diagnosis.closed_loop.servo_gains._error", error)
    found = with_servo_gains(arm, [cast(Any, None)])
    expected = times if is_a_servo_of_the_arm else 1.0
    np.testing.assert_allclose(servo_gains(found).position / own.position, expected)
    np.testing.assert_allclose(servo_gains(found).velocity / own.velocity, 1.0)


def test_a_loop_whose_currents_are_ahead_as_a_whole_misses_no_more(tmp_path: Path) -> None:
    """By 0.7 ms: when in their period servos read encoders is in no model; angles do not show it."""
    motion = fourier("run", 1, 0.12, 0.9, 3.0)
    write_recording(tmp_path / "fit_0.mcap", recorded(truth(motion, (), LABORATORY), LABORATORY, 1), LABORATORY)
    (recording,), _ = read_recordings(tmp_path)
    t = recording.t
    ahead = CubicSpline(t, recording.i)(np.minimum(t + 0.7e-3, t[-1]))
    arm = read_model(MODEL)

    missed, as_recorded = (
        np.sqrt(np.mean(loop_errors(arm, one)[0] ** 2, axis=0)) for one in (replace(recording, i=ahead), recording)
    )

    np.testing.assert_allclose(missed, as_recorded, rtol=0.1)


@pytest.mark.slow
def test_stiff_joints_behind_servos_of_other_gains_do_not_swing(tmp_path: Path) -> None:
    fit, held_out = _recordings(tmp_path, (), replace(LABORATORY, gains=1.5))
    assert transmission_resonance(read_model(MODEL), fit, held_out, range(1, 7)) is None


@pytest.mark.slow
def test_a_spring_behind_servos_of_other_gains(tmp_path: Path) -> None:
    """The loops of the model's gains miss every joint by more than the spring makes."""
    spring = Hidden("joint_compliance", 3, {"stiffness": 30_000.0, "damping": 27.0})
    fit, held_out = _recordings(tmp_path, (spring,), replace(LABORATORY, gains=1.5))

    cause = transmission_resonance(read_model(MODEL), fit, held_out, range(1, 7))

    assert cause is not None and cause.key == ("joint_compliance", 3)
    assert abs(cause.parameters[0].value - 30_000.0) < 2 * cause.parameters[0].std < 5_000.0
    assert "servo gains" in cause.evidence


@pytest.mark.slow
def test_servos_that_are_not_the_model_s_are_no_spring(tmp_path: Path) -> None:
    fit, held_out = _recordings(tmp_path, ())
    arm = read_model(MODEL)
    assert arm.controller is not None
    other = replace(arm.controller, current_lag=3.0 * arm.controller.current_lag)
    assert transmission_resonance(replace(arm, controller=other), fit, held_out, range(1, 7)) is None


@pytest.mark.parametrize(
    ("ratios", "searched"),
    [
        # a spring of 8 kN m/rad at joint 1 swings the whole arm (seed 51602 of tests.blind)
        ([32.4, 7.2, 6.2, 4.0, 4.0, 4.3], True),
        ([1.2, 1.1, 5.0, 1.0, 1.3, 0.9], True),
        # servos that are not the arm's
        ([8.1, 7.2, 6.2, 5.0, 4.9, 6.3], False),
        ([1.2, 1.1, 1.9, 1.0, 1.3, 0.9], False),
        ([9.0], False),
    ],
)
def test_joints_that_one_other_swings_are_no_sign_of_other_servos(ratios: list[float], searched: bool) -> None:
    assert _at_few_joints(np.array(ratios)) is searched


@pytest.mark.slow
def test_springs_of_neighbouring_joints_have_their_own_stiffness(tmp_path: Path) -> None:
    """20 Hz at joint 2 and 40 Hz at joint 3: each oscillates with the other."""
    values = {2: {"stiffness": 30_000.0, "damping": 60.0}, 3: {"stiffness": 12_000.0, "damping": 25.0}}
    hidden = tuple(Hidden("joint_compliance", joint, of_joint) for joint, of_joint in values.items())
    fit, held_out = _recordings(tmp_path, hidden)

    result = diagnose(read_model(MODEL), fit, held_out)

    assert {cause.key for cause in result.causes} == {("joint_compliance", 2), ("joint_compliance", 3)}
    for cause in result.causes:
        assert cause.joint is not None
        for parameter in cause.parameters:
            assert abs(parameter.value - values[cause.joint][parameter.name]) < 3 * parameter.std
    assert result.verdict == "explained"


def test_a_spring_that_the_currents_named_at_a_neighbour_hides_none(tmp_path: Path) -> None:
    """Joint 2 has the spring. Along the motion it was named at joint 3, where closed loops find none."""
    spring = Hidden("joint_compliance", 2, {"stiffness": 30_000.0, "damping": 60.0})
    fit, held_out = _recordings(tmp_path, (spring,), seconds=4.0)
    estimates = [Estimate("stiffness", 2.4e3, 1e2, "N m/rad"), Estimate("damping", 17.0, 2.0, "N m s/rad")]
    wrong = Cause(
        effect="joint_compliance",
        joint=3,
        parameters=estimates,
        confidence=0.9,
        before=4e-3,
        after=3e-3,
        group=(("joint_compliance", 3),),
        evidence="",
        felt_at=3,
        unit="A",
    )
    currents = cast(Any, SimpleNamespace(base=read_model(MODEL), arm=read_model(MODEL), causes=[wrong]))

    cause = resonance_in_loop(currents, Split(fit[:1], held_out))

    assert cause is not None and cause.key == ("joint_compliance", 2)
    assert abs(cause.parameters[0].value - 30_000.0) < 3 * cause.parameters[0].std
    assert resonance_in_loop(currents, Split(fit[:1], held_out), [cause]) is None


@pytest.mark.parametrize(("damping", "overdamped"), [(60.0, False), (600.0, False), (1600.0, True)])
def test_a_spring_without_a_resonance_is_none(damping: float, overdamped: bool) -> None:
    """What servos do at their setpoints was a spring of 433 kN m/rad with 1600 N m s/rad, 0.6 of the critical."""
    spring = {"stiffness": 4.33e5, "damping": damping}
    assert resonance._overdamped(spring, 3.9) is overdamped
    assert not resonance._overdamped({"half_gap": 1e-3}, 3.9)


@pytest.mark.parametrize(
    ("with_it", "named"),
    [
        ((3.8, 1.2, 1.2), True),  # the first joint as it was, which the spring does not move
        ((3.8, 1.2, 5.0), False),  # the third is worse
        ((3.8, 4.0, 1.2), False),  # too little of its own joint
    ],
)
def test_a_spring_is_judged_by_the_joints_that_it_moves(
    monkeypatch: pytest.MonkeyPatch, with_it: tuple[float, ...], named: bool
) -> None:
    """A spring of joint 2, of 98 % of its error, was none because joint 1 had another, which it left as it was."""
    rng, without, rows = np.random.default_rng(1), np.array([3.8, 5.0, 2.0]), 5000
    noise, pattern = rng.normal(size=(rows, 3)), rng.normal(size=(rows, 3))

    def errors(arm: object, recording: object, trials: object = (), **_: object) -> np.ndarray:
        size = np.array(with_it) if trials else without
        return np.asarray((noise + np.sqrt(size**2 - 1.0) * pattern)[None])

    monkeypatch.setattr(resonance, "loop_errors", errors)
    monkeypatch.setattr(resonance, "_estimates", lambda *_: [])
    trial = resonance.Trial("joint_compliance", 2, {"stiffness": 7e4, "damping": 30.0})
    recording, arm = cast(Recording, SimpleNamespace(dt=4e-3)), read_model(MODEL)
    cause = resonance._judged(arm, arm, trial, [], [recording], np.ones(3))
    assert (cause is not None) == named
