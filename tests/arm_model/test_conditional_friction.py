"""Friction over load and temperature: hand-written laws, compiled batches, a course of temperatures, files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_io import InputError
from arm_model import Arm, Joint, read_model, write_model
from arm_model.effects import CATALOGUE, Signals, Values
from arm_model.rigid_body import drive_rigid_torque
from arm_model.simulation import simulate, simulate_batch
from arm_model.system import inverse_dynamics
from arm_model.tables.temperatures import Temperatures, constant_temperatures, recorded_temperatures
from tests.arm_model.random_arms import random_arm, random_states

RUB = {"coulomb": -0.05, "viscous": -0.2, "breakaway": 0.08, "stribeck_velocity": 0.3, "thinning": 25.0}


def rubbing(arm: Arm, degc: float | None = 30.0) -> Arm:
    """With load friction at joint 1, a hump over its load at joint 2, and friction over temperature at joint 2."""
    joints = tuple(replace(joint, temperature=degc) for joint in arm.joints)
    arm = replace(arm, joints=joints).with_effect("load_friction", 1, mu=0.1)
    arm = arm.with_effect("load_breakaway", 2, share=0.2, stribeck_velocity=0.5)
    return arm.with_effect("temperature_friction", 2, **RUB)


def by_hand(v: np.ndarray, warmer: np.ndarray) -> np.ndarray:
    """N m against the motion at speeds v > 0."""
    thin = 25.0 * (1 - np.exp(-warmer / 25.0))
    return warmer * (-0.05 + 0.08 * np.exp(-((v / 0.3) ** 2))) - 0.2 * thin * v


@pytest.mark.parametrize("seed", range(3))
def test_inverse_dynamics_adds_the_laws_written_by_hand(seed: int) -> None:
    plain = random_arm(seed)
    q, v, a = random_states(seed, len(plain))
    t = np.linspace(0.0, 100.0, len(q))
    course = Temperatures((0.0, 40.0, 60.0), ((20.0, 28.0, 50.0),) * len(plain))
    warm = replace(rubbing(plain), temperatures=course)
    added = inverse_dynamics(warm, q, v, a, time=t) - inverse_dynamics(plain, q, v, a, time=t)
    load = np.abs(drive_rigid_torque(plain, q, v, a))
    sign = v / np.hypot(v, plain.joint_array("sign_velocity"))
    expected = np.zeros_like(v)
    expected[:, 0] = 0.1 * load[:, 0] * sign[:, 0]
    expected[:, 1] = 0.2 * load[:, 1] * np.exp(-((v[:, 1] / 0.5) ** 2)) * sign[:, 1]
    warmer = np.interp(t, (0.0, 40.0, 60.0), (-10.0, -2.0, 20.0))
    speed = np.abs(v[:, 1])
    thin = 25.0 * (1 - np.exp(-warmer / 25.0))
    expected[:, 1] += warmer * (-0.05 + 0.08 * np.exp(-((speed / 0.3) ** 2))) * sign[:, 1] - 0.2 * thin * v[:, 1]
    np.testing.assert_allclose(added, expected, atol=1e-9)


def test_without_a_temperature_friction_is_that_of_the_file() -> None:
    plain = random_arm(1)
    q, v, a = random_states(1, len(plain))
    cold, same = rubbing(plain), replace(rubbing(plain), temperatures=constant_temperatures(30.0, len(plain)))
    deaf = replace(rubbing(plain, degc=None), temperatures=constant_temperatures(80.0, len(plain)))
    for arm in (same, deaf):
        np.testing.assert_allclose(inverse_dynamics(arm, q, v, a), inverse_dynamics(cold, q, v, a), atol=1e-12)


def test_a_wheel_that_warms_up_runs_as_an_independent_integration_says() -> None:
    wheel = Joint(inertia=(0.3, 0.3, 0.3, 0, 0, 0), coulomb=(0.5, 0.5), viscous=(2.0, 2.0), temperature=30.0)
    arm = replace(
        Arm("wheel", (wheel,)).with_effect("temperature_friction", 1, **RUB),
        temperatures=Temperatures((0.0, 1.0, 2.0), ((30.0, 35.0, 45.0),)),
    )

    def rate(t: float, state: np.ndarray) -> list[float]:
        v, warmer = state[1], np.interp(t, (0.0, 1.0, 2.0), (0.0, 5.0, 15.0))
        return [v, (4.0 - v / np.hypot(v, 0.01) * (0.5 + 2.0 * abs(v) + by_hand(abs(v), warmer))) / 0.3]

    times = np.linspace(0.0, 2.0, 21)
    driven = {"parameters": {"joint1.temperature_friction.viscous": np.array([-0.2, 0.0])}}
    ours = simulate_batch(arm, lambda t: np.full((len(t), 1), 4.0), times, **driven).q[:, :, 0]
    theirs = solve_ivp(rate, (0, 2), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-11, max_step=1e-3).y[0]
    np.testing.assert_allclose(ours[0], theirs, atol=1e-3 * np.ptp(theirs))
    assert np.ptp(ours[1] - theirs) > 0.02 * np.ptp(theirs)
    cold = simulate(replace(arm, temperatures=None), lambda t: np.full((len(t), 1), 4.0), duration=2.0, rate=10.0)
    assert np.ptp(cold.q[:, 0] - theirs) > 0.02 * np.ptp(theirs)


def test_a_recorded_course_is_smooth_and_bridges_what_is_missing() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    true = 30.0 + 20.0 * (1 - np.exp(-t / 60.0))
    seen = np.round(true + 0.1 * np.random.default_rng(3).normal(size=len(t)))
    seen[200:450] = np.nan
    course = recorded_temperatures(t, np.column_stack([seen, np.full_like(t, np.nan)]))
    assert course is not None
    assert course.at(1, t) is None
    np.testing.assert_allclose(course.at(0, t), true, atol=0.6)
    assert recorded_temperatures(t, None) is None
    assert recorded_temperatures(t[:1], np.array([[25.0]])) == Temperatures((0.0,), ((25.0,),))


def test_models_come_back_from_their_files_without_the_temperatures_of_a_day(tmp_path: Path) -> None:
    arm = replace(rubbing(random_arm(2)), temperatures=constant_temperatures(50.0, len(random_arm(2))))
    write_model(tmp_path / "arm.toml", arm)
    back = read_model(tmp_path / "arm.toml")
    assert back == arm
    assert back.temperatures is None
    with pytest.raises(InputError, match="thinning: is missing"):
        inverse_dynamics(
            arm.with_effect("temperature_friction", 1, coulomb=0.1, stribeck_velocity=0.1), *np.zeros((3, 1, len(arm)))
        )


def test_friction_of_the_published_form_over_temperature_is_within_a_twentieth() -> None:
    """The form of Bittencourt, Gunnarsson (2012), coefficients of their order: its hump widens as it warms."""
    v, warm = np.meshgrid(np.geomspace(2.0, 280.0, 60), np.linspace(34.0, 80.0, 24))
    hump = (-2.44e-2 + 1.69e-3 * warm) * np.exp(-((v / (-25.0 + 1.0 * warm)) ** 1.3))
    truth = (3.04e-2 + hump + (1.29e-4 + 1.31e-3 * np.exp(-warm / 20.71)) * v).ravel()
    law = CATALOGUE["temperature_friction"].torque
    assert law is not None

    def left(velocity: float, thinning: float) -> float:
        held = {"stribeck_velocity": velocity, "thinning": thinning}
        seen = Signals(v=v.ravel(), sign=1.0, warmer=warm.ravel() - 57.0)
        sizes = [{"coulomb": 1.0}, {"viscous": 1.0}, {"breakaway": 1.0}]
        rest = {"coulomb": 0.0, "viscous": 0.0, "breakaway": 0.0}
        columns = [law(Values(held | rest | one), seen) for one in sizes]
        over_speed = np.tile(np.eye(60), (24, 1))  # a curve of free shape
        x = np.column_stack([over_speed, *columns])
        return float(np.sqrt(np.mean((truth - x @ np.linalg.lstsq(x, truth, rcond=None)[0]) ** 2)))

    best = min(left(velocity, thinning) for velocity in np.geomspace(10, 100, 8) for thinning in (15.0, 25.0, 60.0))
    spread = float(np.sqrt(np.mean((truth - np.tile(truth.reshape(24, 60).mean(axis=0), 24)) ** 2)))
    assert best < 0.05 * float(np.sqrt(np.mean(truth**2)))
    assert best < 0.4 * spread
