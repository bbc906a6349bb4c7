"""Closed loops that cannot judge: no rotor behind a transmission, or a servo that does not hold the arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import Arm
from arm_model.description import Joint
from arm_model.servo import fixed_gains
from armscope.model_text.summary import summary, summary_text
from daq.recording import Recording
from diagnosis.closed_loop import resonance
from diagnosis.closed_loop.comparison import compare, refuted, with_smoothing_velocities
from diagnosis.closed_loop.loop_errors import left_over_in_loop, loop_of
from diagnosis.residual.generation import residual_run
from diagnosis.result_warnings import not_simulated


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/starters/csv/model.toml")


@pytest.fixture(scope="module")
def recording(arm: Arm, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    motion = armscope.read_experiment(root / "config/starters/csv/fit.toml")
    pause, series = motion.segment[:2]
    short = motion.model_copy(update={"segment": [pause, series.model_copy(update={"duration": 1.0, "fade": 0.3})]})
    return armscope.simulate(arm, short).write(tmp_path_factory.mktemp("loops") / "run.mcap")


def test_a_spring_without_a_rotor_leaves_the_friction_as_it_is(arm: Arm, recording: Recording) -> None:
    first = replace(arm.joints[0], rotor_inertia=0.0, coulomb=(0.1, 0.1))
    sprung = replace(arm, joints=(first, *arm.joints[1:])).with_effect("joint_compliance", 1, stiffness=1e4)
    assert with_smoothing_velocities(sprung, [recording]) == sprung


@pytest.mark.parametrize("effect", [("joint_compliance", {"stiffness": 1e4}), ("backlash", {"half_gap": 1e-3})])
def test_a_spring_between_no_rotor_or_no_link_is_refused_in_one_line(
    arm: Arm, root: Path, effect: tuple[str, dict[str, float]]
) -> None:
    last, name, values = arm.joints[-1], effect[0], effect[1]
    number = len(arm)
    no_rotor = replace(arm, joints=(*arm.joints[:-1], replace(last, rotor_inertia=0.0)))
    massless = replace(last, rotor_inertia=1e-3, mass=0.0, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6)
    no_link = replace(arm, joints=(*arm.joints[:-1], massless))
    motion = root / "config/starters/csv/fit.toml"
    with pytest.raises(InputError, match=rf"joint {number} has a two-mass transmission but no rotor_inertia"):
        armscope.simulate(no_rotor.with_effect(name, number, **values), motion)
    with pytest.raises(InputError, match=rf"joint {number} has a two-mass transmission, but nothing behind it"):
        armscope.simulate(no_link.with_effect(name, number, **values), motion)


def test_a_joint_that_moves_no_inertia_is_named(arm: Arm, root: Path) -> None:
    idle = Joint(type="revolute")
    with pytest.raises(InputError, match=f"joint {len(arm)} moves no inertia of its own; give its drive a rotor_in"):
        armscope.simulate(replace(arm, joints=(*arm.joints[:-1], idle)), root / "config/starters/csv/fit.toml")


def _driven_away(arm: Arm) -> Arm:
    """With a servo that pushes the arm away from where it should be."""
    held = fixed_gains(arm)
    assert held.controller is not None
    gains = tuple(-1e6 * abs(gain) for gain in held.controller.position_gain or ())
    return replace(held, controller=replace(held.controller, kind="gains", position_gain=gains))


def test_a_loop_that_leaves_all_bounds_leaves_the_friction_as_it_is(arm: Arm, recording: Recording) -> None:
    lost = _driven_away(replace(arm, joints=tuple(replace(one, coulomb=(0.1, 0.1)) for one in arm.joints)))
    late = lost.with_effect("time_skew", delay=0.002)
    for one in (lost, late):
        assert with_smoothing_velocities(one, [recording]) == one


def test_a_smaller_error_without_a_cause_refutes_it_and_a_loop_that_is_not_stable_does_not(
    arm: Arm, recording: Recording
) -> None:
    noisy = replace(recording, i=recording.i + 0.01 * np.random.default_rng(1).normal(size=recording.i.shape))
    run = residual_run("run", arm, noisy.t, noisy.q, noisy.i)
    right = fixed_gains(arm)
    wrong = right.with_effect("current_offset", 1, offset=0.02)
    unlimited = _driven_away(replace(arm, joints=tuple(replace(one, torque_limit=None) for one in arm.joints)))
    assert compare(noisy, unlimited, run) is None
    assert refuted(wrong, [unlimited, right], [1, 1], [noisy], [run]) == 1
    assert refuted(right, [unlimited, wrong], [1, 1], [noisy], [run]) is None


def test_a_loop_that_grows_without_end_is_not_stable_though_its_numbers_are_finite(
    arm: Arm, recording: Recording
) -> None:
    """Sliding joints without friction, driven away from their demands: exp(45 t)."""
    sliding = [
        replace(one, type="prismatic", viscous=(0.0, 0.0), coulomb=(0.0, 0.0), torque_limit=None) for one in arm.joints
    ]
    held = fixed_gains(replace(arm, joints=tuple(sliding)))
    assert held.controller is not None and held.controller.position_gain is not None
    gains = tuple(-3.0 * gain for gain in held.controller.position_gain)
    driven = replace(held, controller=replace(held.controller, position_gain=gains))
    assert np.isnan(loop_of(driven, recording)[1]).any()
    # a file of the model could not hold it
    assert not left_over_in_loop(driven, [recording]).any()


def test_where_no_spring_leaves_the_loop_stable_none_is_named(
    arm: Arm, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a servo for the whole inertia is stable on a rigid joint, and not on a rotor of a thousandth behind a soft spring
    assert arm.controller is not None
    held = fixed_gains(
        replace(arm, controller=replace(arm.controller, velocity_bandwidth=None, current_lag=0.0, servo_period=0.002))
    )
    joints = tuple(replace(one, torque_limit=None, rotor_inertia=1e-3 * one.rotor_inertia) for one in held.joints)
    light = replace(held, joints=joints)
    motion = armscope.read_experiment(root / "config/starters/csv/fit.toml")
    pause, series = motion.segment[:2]
    short = motion.model_copy(update={"segment": [pause, series.model_copy(update={"duration": 3.0, "fade": 0.3})]})
    run = armscope.simulate(light, short).write(tmp_path / "run.mcap")
    wave = np.outer(2.0 * np.sin(2.0 * np.pi * 40.0 * run.t), [1.0] + [0.0] * (len(arm) - 1))
    monkeypatch.setattr(resonance, "LIMITS", replace(resonance.LIMITS, fastest=10.0))
    waving = replace(run, i=run.i + wave)
    assert resonance.transmission_resonance(light, [waving], [waving], [1]) is None


def test_an_extended_model_without_a_rotor_behind_its_spring_says_so(arm: Arm, root: Path) -> None:
    first = replace(arm.joints[0], rotor_inertia=0.0)
    sprung = replace(arm, joints=(first, *arm.joints[1:])).with_effect("joint_compliance", 1, stiffness=1e4)
    assert [*not_simulated(sprung)] == [
        "the extended model cannot be simulated: joint compliance of joint 1 needs a rotor_inertia of that joint; "
        "give it one"
    ]
    assert not [*not_simulated(arm.with_effect("joint_compliance", 1, stiffness=1e4))]
    described = summary(sprung)
    assert "no rotor_inertia" in described["not_simulated"] and described["operations"] is None
    assert "cannot be simulated: joint 1" in summary_text(described)
    assert summary(arm)["not_simulated"] is None
