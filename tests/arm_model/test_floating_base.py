"""An arm on a floating base: identities, MuJoCo and Pinocchio as oracles, closed forms in water, momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_model.description import Arm, Joint
from arm_model.moving_base.numeric import (
    BaseRows,
    forces_with_base,
    mass_matrix_with_base,
    rotations,
)
from arm_model.rigid_body import kinematics
from arm_model.rigid_body.numeric import drive_torque, rigid_torque
from arm_model.simulation.sensitivity import sensitivities
from arm_model.simulation.simulation import simulate, simulate_at, system_of
from arm_model.simulation.stepper import Stepper
from arm_model.symbolic.tape import evaluate
from arm_model.system.kernel_inputs import numbers
from arm_model.tables import FloatingBase, StationKeeping, Thruster
from arm_model.tables.controller import Controller
from tests.arm_model.floating_arms import floating_arm, random_rows
from tests.arm_model.mujoco_arms import mujoco_model, tensor_of
from tests.arm_model.oracles import accelerations_with_base, momentum_of
from tests.arm_model.random_arms import random_states

SEEDS = range(6)
LIGHT = Joint(mass=1e-9, inertia=(1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0), rotor_inertia=1.0)
"""A joint that is there because an arm has one, and matters to nothing."""


def alone(base: FloatingBase, **entries: object) -> Arm:
    """A base without an arm to speak of."""
    return Arm(name="vehicle", joints=(LIGHT,), floating=base, **entries)  # type: ignore[arg-type]


def ball(mass: float = 10.0, **entries: object) -> FloatingBase:
    return FloatingBase(mass=mass, inertia=(0.4, 0.4, 0.4, 0.0, 0.0, 0.0), **entries)  # type: ignore[arg-type]


def free(arm: Arm, start: np.ndarray, duration: float, rate: float = 50.0) -> object:
    begin = np.concatenate([np.zeros(len(arm)), start])
    return simulate(arm, lambda t: np.zeros((len(t), len(arm))), duration=duration, rate=rate, start=begin).base


def placed(position: tuple[float, ...] = (0, 0, 0), quaternion: tuple[float, ...] = (1, 0, 0, 0)) -> np.ndarray:
    return np.array([*position, *quaternion, *(0.0,) * 6], float)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("water", [False, True])
def test_forces_are_mass_matrix_times_rates_and_what_is_there_without(seed: int, water: bool) -> None:
    arm, rows = floating_arm(seed, water=water), random_rows(seed)
    q, qd, qdd = random_states(seed, len(arm))
    matrix = mass_matrix_with_base(arm, q)
    still = forces_with_base(arm, replace(rows, rate=None), q, qd, 0 * qdd)
    expected = still + np.einsum("nij,nj->ni", matrix, np.concatenate([rows.rate, qdd], axis=1))
    np.testing.assert_allclose(forces_with_base(arm, rows, q, qd, qdd), expected, rtol=1e-9, atol=1e-9)
    assert np.linalg.eigvalsh(matrix).min() > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_generated_equations_agree_with_the_recursion(seed: int) -> None:
    arm, rows = floating_arm(seed, water=True, friction=True), random_rows(seed)
    n, (q, qd, _) = len(arm), random_states(seed, 4)
    given = np.random.default_rng(seed).normal(size=(len(q), n + 2))
    system = system_of(arm)
    state = {f"theta{j}": q[:, j] for j in range(n)} | {f"speed{j}": qd[:, j] for j in range(n)}
    state |= {f"attitude{k}": rows.attitude[:, k] for k in range(4)}
    state |= {f"velocity{k}": rows.velocity[:, k] for k in range(6)} | {f"position{k}": 0.0 for k in range(3)}
    state |= {f"current{k}": given[:, k] for k in range(n + 2)} | {"time": 0.0}
    found = dict(zip(system.states, evaluate(system.tape, system.rates, {**numbers(arm), **state})))
    moved = np.stack([*(found[f"velocity{k}"] for k in range(6)), *(found[f"speed{j}"] for j in range(n))], axis=1)
    gains = [thruster.gain for thruster in arm.floating.thruster]
    drives = np.stack([drive_torque(joint, qd[:, j], 0 * qd[:, j]) for j, joint in enumerate(arm.joints)], axis=1)
    wrench, torque = given[:, n:] * gains @ arm.floating.allocation.T, given[:, :n] * arm.joint_array("drive_constant")
    forces = np.concatenate([wrench, torque - drives], axis=1)
    np.testing.assert_allclose(moved, accelerations_with_base(arm, rows, q, qd, forces), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_base_that_stands_gives_the_torques_of_a_fixed_one(seed: int) -> None:
    arm = floating_arm(seed, water=True)
    q, qd, qdd = random_states(seed, len(arm))
    attitude = random_rows(seed).attitude
    forces = forces_with_base(arm, BaseRows(attitude, np.zeros((len(q), 6))), q, qd, qdd)
    for k, turn in enumerate(rotations(attitude)):
        fixed = replace(arm, floating=None, gravity=tuple(map(float, turn.T @ np.array(arm.gravity))))
        expected = rigid_torque(fixed, q[k], qd[k], qdd[k])[0]
        np.testing.assert_allclose(forces[k, 6:], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_with_a_free_joint_agrees(seed: int) -> None:
    mujoco = pytest.importorskip("mujoco")
    arm, rows = floating_arm(seed), random_rows(seed, 5)
    model = mujoco_model(arm)
    data = mujoco.MjData(model)
    states = random_states(seed, len(arm), 5)
    ours = forces_with_base(arm, rows, *states)
    for k, turn in enumerate(rotations(rows.attitude)):
        v, w, rate = rows.velocity[k, :3], rows.velocity[k, 3:], rows.rate[k]
        q, qd, qdd = (one[k] for one in states)
        # MuJoCo's free joint: velocity and acceleration of the origin in the world, rates in the body
        data.qpos = [*np.zeros(3), *rows.attitude[k], *q]
        data.qvel = [*(turn @ v), *w, *qd]
        data.qacc = [*(turn @ (rate[:3] + np.cross(w, v))), *rate[3:], *qdd]
        mujoco.mj_inverse(model, data)
        theirs = np.concatenate([turn.T @ data.qfrc_inverse[:3], data.qfrc_inverse[3:]])
        np.testing.assert_allclose(ours[k], theirs, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_pinocchio_with_a_free_flyer_agrees(seed: int) -> None:
    pin = pytest.importorskip("pinocchio")
    arm, rows = floating_arm(seed), random_rows(seed, 5)
    base = arm.floating
    model = pin.Model()
    model.gravity.linear = np.array(arm.gravity)
    parent = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(
        parent, pin.Inertia(base.mass, np.array(base.com), tensor_of(base.inertia)), pin.SE3.Identity()
    )
    pose = np.array(arm.base)
    for j, joint in enumerate(arm.joints):
        before, after = kinematics.placement(joint)
        kind = pin.JointModelRZ() if joint.revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, pin.SE3(pose @ before), f"joint{j}")
        body = pin.Inertia(joint.mass, np.array(joint.com), tensor_of(joint.inertia))
        model.appendBodyToJoint(parent, body, pin.SE3(after))
        pose = after
    data = model.createData()
    q, qd, qdd = random_states(seed, len(arm), 5)
    ours, matrix = forces_with_base(arm, rows, q, qd, qdd), mass_matrix_with_base(arm, q)
    for k in range(5):
        w, x, y, z = rows.attitude[k]
        at = np.array([0.0, 0.0, 0.0, x, y, z, w, *q[k]])
        theirs = pin.rnea(model, data, at, np.r_[rows.velocity[k], qd[k]], np.r_[rows.rate[k], qdd[k]])
        np.testing.assert_allclose(ours[k], theirs, rtol=1e-8, atol=1e-8)
        upper = np.triu(pin.crba(model, data, at))
        np.testing.assert_allclose(np.triu(matrix[k]), upper, rtol=1e-8, atol=1e-8)


def test_momentum_is_kept_without_forces_whatever_the_motors_do() -> None:
    arm = replace(floating_arm(4, joints=3), gravity=(0.0, 0.0, 0.0))
    arm = replace(arm, joints=tuple(replace(joint, rotor_inertia=0.0) for joint in arm.joints))
    begin = np.array([0.1, -0.4, 0.3, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0, 0.2, -0.1, 0.3, 0.2, 0.1, -0.3])
    push = np.array([0.5, -0.3, 0.4])
    times = np.linspace(0.0, 2.0, 41)
    done = simulate_at(arm, lambda t: push * np.sin(3 * t)[:, None], times, start=begin, substeps=2)
    rows = BaseRows(done.base.attitude, done.base.velocity)
    kept = momentum_of(arm, done.base.position, rows, done.q, done.qd)
    assert np.abs(done.q[-1] - done.q[0]).max() > 0.1
    np.testing.assert_allclose(kept, kept[:1].repeat(len(kept), axis=0), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(done.base.attitude, axis=1), 1.0, atol=1e-9)


def test_a_sphere_sinks_at_its_terminal_velocity() -> None:
    radius, density = 0.2, 1000.0
    displaced = density * 4 / 3 * np.pi * radius**3
    drag = 0.5 * density * 0.47 * np.pi * radius**2
    sphere = ball(
        mass=displaced + 10.0,
        added_mass=(displaced / 2,) * 3 + (0.0,) * 3,
        quadratic_drag=(drag,) * 3 + (0.0,) * 3,
        displaced_mass=displaced,
    )
    done = free(alone(sphere), placed(), 20.0)
    terminal = np.sqrt(10.0 * 9.80665 / drag)
    # from rest: v = v_t tanh(t / tau), tau = (m + m_a) v_t / ((m - displaced) g)
    tau = (displaced + 10.0 + displaced / 2) * terminal / (10.0 * 9.80665)
    t = np.arange(len(done.velocity)) / 50.0
    np.testing.assert_allclose(done.velocity[:, 2], -terminal * np.tanh(t / tau), atol=2e-7 * terminal)
    np.testing.assert_allclose(done.position[-1, 2], -terminal * tau * np.log(np.cosh(t[-1] / tau)), rtol=1e-6)


def test_a_cylinder_in_yaw_has_its_added_moment_of_inertia() -> None:
    """Slender cylinder of length L in potential flow: rho pi R^2 L^3 / 12 about its middle (Newman 1977, 4.15)."""
    added = 1025.0 * np.pi * 0.1**2 * 2.0**3 / 12
    push = Thruster((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-50.0, 50.0))
    vehicle = FloatingBase(
        mass=60.0, inertia=(0.3, 20.0, 20.0, 0.0, 0.0, 0.0), added_mass=(0.0,) * 5 + (added,), thruster=(push,)
    )
    arm = alone(vehicle, gravity=(0.0, 0.0, 0.0))
    done = simulate(arm, lambda t: np.tile([0.0, 5.0], (len(t), 1)), duration=2.0, rate=10.0)
    np.testing.assert_allclose(done.base.velocity[:, 5], 5.0 * done.t / (20.0 + added), rtol=1e-6, atol=1e-12)


def test_a_neutral_vehicle_swings_about_its_centre_of_buoyancy() -> None:
    height, mass, inertia = 0.1, 10.0, 0.4
    vehicle = ball(displaced_mass=mass, buoyancy_centre=(0.0, 0.0, height), added_mass=(0.0,) * 4 + (0.2, 0.0))
    w = np.sqrt(mass * 9.80665 * height / (inertia + 0.2))
    tilt = 1e-3
    done = free(alone(vehicle), placed(quaternion=(np.cos(tilt / 2), 0, np.sin(tilt / 2), 0)), 5.0)
    t = np.arange(len(done.attitude)) / 50.0
    np.testing.assert_allclose(2 * done.attitude[:, 2], tilt * np.cos(w * t), atol=1e-6 * tilt + 1e-8)
    assert np.abs(done.position).max() < 1e-7  # the joint weighs 1e-9 kg


def test_kirchhoff_turns_a_body_that_slides_obliquely() -> None:
    """Munk moment: (A_y - A_x) u v about z, of a body held to its course."""
    vehicle = ball(added_mass=(2.0, 12.0, 12.0, 0.0, 0.0, 0.0))
    rows = BaseRows(np.array([[1.0, 0, 0, 0]]), np.array([[0.8, 0.5, 0, 0, 0, 0]]))
    wrench = forces_with_base(alone(vehicle, gravity=(0.0, 0.0, 0.0)), rows, *np.zeros((3, 1, 1)))[0, :6]
    np.testing.assert_allclose(wrench, [0, 0, 0, 0, 0, (12.0 - 2.0) * 0.8 * 0.5], atol=1e-12)


def test_thrusters_obey_limits_gain_and_lag() -> None:
    push = Thruster((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (-3.0, 8.0), gain=0.5, time_constant=0.4)
    arm = alone(ball(thruster=(push,)), gravity=(0.0, 0.0, 0.0))
    done = simulate(arm, lambda t: np.tile([0.0, 20.0], (len(t), 1)), duration=2.0, rate=10.0)
    assert (done.base.demand[1:] == 8.0).all()
    expected = 0.5 * 8.0 / 10.0 * (done.t - 0.4 * (1 - np.exp(-done.t / 0.4)))
    np.testing.assert_allclose(done.base.velocity[:, 0], expected, rtol=1e-6, atol=1e-9)


def kept_station(feedforward: float) -> float:
    """m: how far a vehicle is thrown by its arm, which swings once."""
    cage = [((x, y, z), d) for x, y, z, d in _CAGE]
    base = FloatingBase(
        mass=20.0,
        inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        added_mass=(10.0, 10.0, 20.0, 0.5, 0.5, 0.5),
        linear_drag=(10.0,) * 6,
        displaced_mass=22.0,
        buoyancy_centre=(0.0, 0.0, 0.05),
        thruster=tuple(Thruster(at, along, (-80.0, 80.0)) for at, along in cage),
        controller=StationKeeping(natural_frequency=(1.5,) * 6, integral_rate=0.3, feedforward=feedforward),
    )
    joint = Joint(convention="placed", mass=3.0, com=(0.4, 0.0, 0.0), inertia=(0.01, 0.1, 0.1, 0.0, 0.0, 0.0))
    servo = Controller(0.005, 0.005, "bandwidth", (15.0,), inertia_pose=(0.0,))
    arm = Arm(name="rov", joints=(joint,), floating=base, controller=servo)

    def swing(t: np.ndarray) -> np.ndarray:
        s = np.clip(t / 2.0, 0.0, 1.0)[:, None]
        return 1.5 * (10 * s**3 - 15 * s**4 + 6 * s**5)

    done = simulate(arm, swing, duration=4.0, rate=50.0)
    assert np.abs(done.q[-1] - 1.5).max() < 0.05
    return float(np.linalg.norm(done.base.position, axis=1).max())


_CAGE = [
    (0.3, 0.3, 0.0, (1.0, 0.0, 0.0)),
    (0.3, -0.3, 0.0, (1.0, 0.0, 0.0)),
    (0.3, 0.0, 0.3, (0.0, 1.0, 0.0)),
    (-0.3, 0.0, -0.3, (0.0, 1.0, 0.0)),
    (0.0, 0.3, 0.0, (0.0, 0.0, 1.0)),
    (0.3, -0.3, 0.0, (0.0, 0.0, 1.0)),
    (-0.3, -0.3, 0.0, (0.0, 0.0, 1.0)),
]


def test_feed_forward_of_the_arms_reaction_holds_the_base() -> None:
    without, half, whole = kept_station(0.0), kept_station(0.5), kept_station(1.0)
    assert without > 0.02
    assert half < 0.6 * without
    assert whole < 0.1 * without


def test_a_stepper_goes_on_where_the_simulation_does() -> None:
    arm = replace(floating_arm(2, water=True), joints=floating_arm(2, friction=True).joints)
    begin = np.concatenate([[0.1, 0.2, -0.3, 0.0], placed((1.0, 2.0, 3.0), (0.6, 0.0, 0.8, 0.0))])
    demands = np.concatenate([np.zeros((40, 4)), np.full((40, 2), 3.0)], axis=1)
    whole = simulate(arm, lambda t: np.tile(demands[0], (len(t), 1)), duration=0.039, rate=1000.0, start=begin)
    stepper = Stepper(arm, begin)
    np.testing.assert_allclose(stepper.base, begin[4:])
    stepper.advance(demands[:17], np.empty(0))
    stepper.advance(demands[17:39], np.empty(0))
    last = np.concatenate([whole.base.position[-1], whole.base.attitude[-1], whole.base.velocity[-1]])
    np.testing.assert_allclose(stepper.base, last, rtol=1e-9, atol=1e-12)


def test_sensitivities_of_the_base_are_those_of_its_motion() -> None:
    """A free body pushed by F has the velocity F t / (m + a): its slope by a is -F t / (m + a)^2."""
    push = Thruster((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (-50.0, 50.0))
    arm = alone(ball(thruster=(push,), added_mass=(5.0, 0.0, 0.0, 0.0, 0.0, 0.0)), gravity=(0.0, 0.0, 0.0))
    times = np.linspace(0.0, 1.0, 6)
    steps = {"base.added_mass_surge": 1e-2}
    motion, slopes = sensitivities(arm, lambda t: np.tile([0.0, 30.0], (len(t), 1)), steps, times)
    assert motion.base is not None
    assert slopes.base is not None
    np.testing.assert_allclose(motion.base.velocity[:, 0], 30.0 * times / 15.0, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(slopes.base.velocity[0, :, 0], -30.0 * times / 15.0**2, rtol=1e-5, atol=1e-9)
