"""The compiled simulation against scipy's integrator, conservation laws, and itself cut into lanes and blocks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_io import InputError
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.parameters import with_parameters
from arm_model.rigid_body import numeric
from arm_model.servo import servo_gains
from arm_model.simulation.lanes import prepared
from arm_model.simulation.servo_references import references, row_times
from arm_model.simulation.simulation import simulate, simulate_at, simulate_batch
from arm_model.simulation.stepper import Stepper
from arm_model.system import dynamics
from arm_model.tables.controller import Controller
from tests.arm_model.oracles import energy_of, forward_dynamics
from tests.arm_model.pumas import swing, three_links
from tests.arm_model.random_arms import in_water, random_arm


@pytest.mark.parametrize("wet", [False, True], ids=["in air", "in water"])
@pytest.mark.parametrize("seed", range(4))
def test_free_motion_is_scipys(seed: int, wet: bool) -> None:
    arm = random_arm(seed, joints=3, friction=seed % 2 == 0)
    arm = in_water(arm, seed) if wet else arm
    arm = replace(arm, joints=tuple(replace(joint, sign_velocity=0.5) for joint in arm.joints))
    drive = arm.joint_array("drive_constant")
    torque = np.array([0.5, -0.4, 0.3])

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[3:], forward_dynamics(arm, x[:3], x[3:], torque)[0]])

    exact = solve_ivp(rates, (0, 0.5), np.zeros(6), t_eval=[0.1, 0.25, 0.5], rtol=1e-11, atol=1e-12, method="DOP853")
    times = np.array([0.1, 0.25, 0.5])
    ours = simulate_at(arm, lambda t: np.tile(torque / drive, (len(t), 1)), times)
    np.testing.assert_allclose(ours.q, exact.y[:3].T, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(ours.qd, exact.y[3:].T, rtol=1e-6, atol=1e-6)


def test_energy_of_an_undriven_frictionless_arm_stays(puma: Arm) -> None:
    arm = three_links(puma)
    joints = tuple(replace(joint, viscous=0.0, coulomb=(0.0, 0.0)) for joint in arm.joints)
    arm = replace(arm, joints=joints, controller=None)
    motion = simulate(arm, lambda t: np.zeros((len(t), 3)), duration=10.0, rate=100, start=np.array([0.0, 0.4, -0.2]))
    # Its motors hold it at the start, so let the currents go: the demand is zero from the first instant.
    energy = energy_of(arm, motion.q, motion.qd)
    swing_energy = np.ptp(energy_of(arm, motion.q, 0 * motion.qd))
    assert swing_energy > 10.0
    assert np.ptp(energy) < 1e-6 * swing_energy


def test_power_balance_under_servo(puma: Arm) -> None:
    """Energy gained = work of the motors - friction, along a servoed move."""
    arm = three_links(puma)
    motion = simulate(arm, swing(3), duration=1.5, rate=10000)
    friction = sum_of_friction(arm, motion.qd)
    power = np.sum((motion.torque - friction) * motion.qd, axis=1)
    gained = energy_of(arm, motion.q, motion.qd)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(motion.t))])
    assert np.ptp(gained) > 5.0
    np.testing.assert_allclose(gained - gained[0], work, atol=2e-4 * np.ptp(gained))


def sum_of_friction(arm: Arm, qd: np.ndarray) -> np.ndarray:
    still = replace(arm, joints=tuple(replace(joint, rotor_inertia=0.0) for joint in arm.joints))
    zero = np.zeros_like(qd)
    columns = [dynamics.drive_torque(joint, qd[:, j], zero[:, j]) for j, joint in enumerate(still.joints)]
    return np.stack(columns, axis=1)


def test_servo_is_what_the_controller_says(puma: Arm) -> None:
    """The servo written out once more, tick by tick in plain numpy, with the arm integrated by scipy between ticks."""
    arm = replace(three_links(puma), joints=tuple(replace(j, sign_velocity=0.2) for j in three_links(puma).joints))
    controller, gains = arm.controller, servo_gains(arm)
    assert controller is not None and controller.velocity_bandwidth is not None
    period, ticks, demand = controller.servo_period, 60, swing(3)
    knots = np.arange(0, 0.2, 0.028)
    drive = arm.joint_array("drive_constant")
    x = np.zeros(6)
    current = dynamics.inverse_dynamics(arm, x[:3], x[3:], x[3:])[0] / drive
    integral, last, last_wanted, velocity = current.copy(), x[:3].copy(), x[:3].copy(), np.zeros(3)
    for tick in range(ticks):
        wanted = np.array([np.interp(tick * period, knots, demand(knots)[:, j]) for j in range(3)])
        share = 1 - np.exp(-controller.velocity_bandwidth * period)
        velocity = velocity + share * ((x[:3] - last) / period - velocity)
        integral = integral + gains.integral * period * (wanted - x[:3])
        ahead = (wanted - last_wanted) / period
        command = gains.position * (wanted - x[:3]) + integral + gains.velocity * (ahead - velocity)
        limit = arm.joint_array("torque_limit") / drive
        command = np.clip(command, -limit, limit)
        last, last_wanted = x[:3].copy(), wanted

        def rates(t: float, x: np.ndarray, i: np.ndarray = current, u: np.ndarray = command) -> np.ndarray:
            flowing = u + (i - u) * np.exp(-t / 0.0004)
            return np.concatenate([x[3:], forward_dynamics(arm, x[:3], x[3:], flowing * drive)[0]])

        x = solve_ivp(rates, (0, period), x, rtol=1e-9, atol=1e-12, method="DOP853").y[:, -1]
        current = command + (current - command) * np.exp(-period / 0.0004)
    ours = simulate_at(arm, demand, np.array([ticks * period]))
    np.testing.assert_allclose(ours.q[0], x[:3], rtol=2e-4)
    np.testing.assert_allclose(ours.current[0], current, rtol=2e-3, atol=1e-4)


def test_standing_arm_stays(puma: Arm) -> None:
    pose = np.array([0.3, 0.5, -1.0, 0.2, 0.5, -0.3])
    motion = simulate(puma, lambda t: np.tile(pose, (len(t), 1)), duration=1.0, rate=100)
    np.testing.assert_allclose(motion.q, np.tile(pose, (len(motion.t), 1)), atol=1e-9)
    held = numeric.rigid_torque(puma, pose, 0 * pose, 0 * pose)[0]
    np.testing.assert_allclose(motion.torque[-1], held, atol=1e-6)


def test_lanes_are_single_simulations(puma: Arm) -> None:
    arm = three_links(puma)
    values = {
        "joint2.viscous": np.linspace(5, 15, 11),
        "joint1.viscous_negative": np.linspace(9, 2, 11),
        "link3.mass": np.linspace(4, 6, 11),
    }
    batch = simulate_batch(arm, swing(3), row_times(1.0, 200), parameters=values)
    assert batch.q.shape == (11, 201, 3)
    for lane in (0, 7, 10):
        changed = with_parameters(arm, {name: value[lane] for name, value in values.items()})
        one = simulate(changed, swing(3), duration=1.0, rate=200)
        np.testing.assert_allclose(batch.q[lane], one.q, atol=1e-10)
        np.testing.assert_allclose(batch.current[lane], one.current, atol=1e-7)


@pytest.mark.parametrize("kind", ["servo", "effects", "vehicle"])
def test_single_precision_stays_with_double(puma: Arm, root: Path, kind: str) -> None:
    """1e-5 rad over 5 s, of 20 lanes in two blocks and of one; the sums of small steps are compensated."""
    arm, reach = three_links(puma), np.array([0.5, -0.4, 0.3])
    parameters = {"joint2.viscous": np.linspace(6.0, 14.0, 20)}
    if kind == "effects":
        arm = arm.with_effect("stribeck_friction", joint=2, breakaway=8.0, stribeck_velocity=0.05)
        arm = arm.with_effect("cogging", joint=1, amplitude=2.0, pole_pairs=4, phase=0.3)
    if kind == "vehicle":
        arm, reach = read_model(root / "config/models/rov_arm.toml"), np.array([0.5, -0.4])
        parameters = {"thruster1.gain": np.linspace(0.5, 1.0, 20)}

    def demand(t: np.ndarray) -> np.ndarray:
        return np.outer(1 - np.cos(2 * t), reach)

    times = row_times(5.0, 5)
    exact = simulate_batch(arm, demand, times, parameters=parameters, substeps=2)
    rounded = simulate_batch(arm, demand, times, parameters=parameters, substeps=2, single=True)
    alone = {name: values[:1] for name, values in parameters.items()}
    one = simulate_batch(arm, demand, times, parameters=alone, substeps=2, single=True)
    assert np.ptp(exact.q, axis=0).max() > 1e-4, "the parameter does something"
    np.testing.assert_allclose(rounded.q, exact.q, atol=1e-5)
    np.testing.assert_array_equal(one.q[0], rounded.q[0])
    if exact.base is not None:
        assert rounded.base is not None
        np.testing.assert_allclose(rounded.base.position, exact.base.position, atol=1e-5, rtol=1e-6)


def test_lanes_that_need_short_steps_do_not_shorten_those_of_other_blocks(puma: Arm) -> None:
    """Eight lanes are what a batch of them alone is; those of the stiff blocks take more steps."""
    arm = three_links(puma).with_effect("joint_compliance", joint=2, stiffness=2e4, damping=20.0)
    name, times = "joint2.joint_compliance.stiffness", row_times(0.5, 100)
    stiffness = np.concatenate([np.linspace(1e4, 2e4, 8), np.linspace(1e6, 2e6, 8)])
    batch = simulate_batch(arm, swing(3), times, parameters={name: stiffness})
    for part in (slice(8), slice(8, 16)):
        alone = simulate_batch(arm, swing(3), times, parameters={name: stiffness[part]})
        np.testing.assert_allclose(batch.q[part], alone.q, atol=1e-12)
    soft, *_, stiff = prepared(arm, {name: stiffness}, np.zeros(3), None).substeps
    assert (soft, stiff) == (1, 4)
    finer = simulate_batch(arm, swing(3), times, parameters={name: stiffness[:8]}, substeps=stiff)
    assert np.abs(finer.q - batch.q[:8]).max() > 1e-9


def test_servos_of_other_gains_are_the_same_program(puma: Arm) -> None:
    arm = three_links(puma)
    gains = servo_gains(arm)
    assert arm.controller is not None
    servo = replace(
        arm.controller,
        kind="gains",
        position_gain=tuple(0.5 * gains.position),
        integral_gain=tuple(0.5 * gains.integral),
        velocity_gain=tuple(gains.velocity),
    )
    other = replace(arm, controller=servo)
    slower = replace(arm, controller=replace(arm.controller, servo_period=2 * arm.controller.servo_period))
    first, second, third = (prepared(one, None, np.zeros(3), None).program for one in (arm, other, slower))
    assert second is first
    assert third is not first
    times = row_times(0.5, 100)
    one, two = (simulate_batch(a, swing(3), times).current for a in (arm, other))
    assert np.abs(one - two).max() > 1e-3 * np.abs(one).max()


def test_blocks_of_time_do_not_matter(puma: Arm) -> None:
    arm = three_links(puma)
    whole, pieces = Stepper(arm, np.zeros(3)), Stepper(arm, np.zeros(3))
    given = references(arm, swing(3), 0, 400)
    rows = np.arange(int(400 * whole.period * 20000)) / 20000
    at_once = whole.advance(given, rows)
    parts, tick = [], 0
    for count in (1, 7, 92, 300):
        end = (tick + count) * pieces.period
        inside = rows[(rows >= tick * pieces.period - 1e-12) & (rows < end - 1e-12)]
        parts.append(pieces.advance(given[tick : tick + count], inside))
        tick += count
    for name in ("t", "q", "qd", "current", "torque"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(at_once, name))


def test_dense_rows_lie_on_the_motion(puma: Arm) -> None:
    """Rows between ticks agree with a simulation of four times the steps."""
    arm = three_links(puma)
    coarse = simulate(arm, swing(3), duration=0.5, rate=20000)
    fine = simulate(arm, swing(3), duration=0.5, rate=20000, substeps=4)
    np.testing.assert_allclose(coarse.q, fine.q, atol=3e-7)
    np.testing.assert_allclose(coarse.current, fine.current, atol=3e-3)


def test_a_wild_servo_gets_one_line(puma: Arm) -> None:
    wild = Controller(kind="gains", position_gain=(1e9,) * 3, velocity_gain=(0.0,) * 3)
    joints = tuple(replace(joint, torque_limit=None) for joint in three_links(puma).joints)
    with pytest.raises(InputError, match="left all bounds before t ="):
        simulate(replace(puma, joints=joints, controller=wild), swing(3), duration=2.0, rate=100)


def test_a_cascade_holds_without_an_integrator(puma: Arm) -> None:
    controller = Controller(kind="cascade", position_gain=(20.0,) * 3, velocity_gain=(30.0,) * 3, setpoint_period=0.01)
    arm = replace(three_links(puma), controller=controller)
    motion = simulate(arm, swing(3, 0.3), duration=2.0, rate=100)
    assert np.abs(motion.q[-1] - motion.demand[-1]).max() < 0.02
