"""The second generator's plant against MuJoCo, against the conservation of energy and against the rigid arm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, filtfilt

from arm_io.types import Array
from arm_model.effects import CATALOGUE
from diagnosis.cause import Cause, Estimate
from experiment import Experiment
from tests.blind.__main__ import drawn
from tests.blind.score import is_own
from tests.blind.second.cases import COUNTS, cases
from tests.blind.second.effects import KINDS
from tests.blind.second.generate import Hidden, strength
from tests.blind.second.laboratory import Laboratory, arm_of, laboratory, own_springs, plant_of
from tests.blind.second.motions import HOME, SPEEDS, suite
from tests.blind.second.plant import Plant, rates, reading, step
from tests.blind.second.rigid_body import mass_matrix, target, torques
from tests.blind.second.sensing import TARGET, Sensing, _angles
from tests.blind.second.simulate import simulated

CALIBRATION_ONLY = {
    "gravity_sag",
    "encoder_scale",
    "encoder_eccentricity",
    "encoder_ovality",
    "transmission_coupling",
}
IDENTIFICATION_ONLY = {"breakaway_rise", "load_breakaway", "temperature_friction"}


@cache
def _where() -> Laboratory:
    return laboratory(4)


def _plant() -> Plant:
    return plant_of(_where(), arm_of(_where()))


def _short() -> Experiment:
    move = {"type": "move", "to": [0.5, 0.1, -0.4, 0.3, 0.1, 0.4], "speed": 0.7}
    back = {"type": "move", "to": HOME, "speed": 0.4}
    return Experiment.model_validate(
        {"name": "short", "start": HOME, "full_speed": SPEEDS, "full_acceleration": [6.0] * 6, "segment": [move, back]}
    )


def _in_mujoco(p: Plant) -> mujoco.MjModel:
    """The links as bodies in their Denavit-Hartenberg frames; a hinge is about z of the frame before."""
    spec = mujoco.MjSpec()
    spec.option.gravity = p.gravity
    spec.compiler.degree = False
    body = spec.worldbody
    for (theta, d, a, alpha), (mass, *com), inertia in zip(p.dh, p.bodies, p.inertia):
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        turn = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0, sa, ca]])
        place = np.array([a * ct, a * st, d])
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, turn.ravel())
        body = body.add_body(pos=place, quat=quaternion)
        body.mass, body.ipos, body.fullinertia = mass, com, inertia
        body.explicitinertial = True
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=turn.T[:, 2], pos=-turn.T @ place)
    return spec.compile()


def test_torques_are_those_of_mujoco_on_random_states() -> None:
    p = _plant()
    model = _in_mujoco(p)
    data = mujoco.MjData(model)
    for q, qd, qdd in np.random.default_rng(1).normal(size=(20, 3, 6)):
        data.qpos, data.qvel, data.qacc = q, qd, qdd
        mujoco.mj_inverse(model, data)
        ours = torques(p.dh, p.bodies, p.inertia, p.cylinders, p.gravity, q, qd, qdd)
        np.testing.assert_allclose(ours, data.qfrc_inverse, rtol=1e-6, atol=1e-7)


def test_water_drags_and_carries_a_link_as_the_integrals_say() -> None:
    # one link in a plane: drag rho C_d R w^2 L^4 / 4, added mass rho C_a pi R^2 L^3 / 3, buoyancy rho pi R^2 L g L / 2
    length, radius = 0.8, 0.05
    dh, bodies, inertia = np.array([[0.0, 0.0, length, 0.0]]), np.zeros((1, 4)), np.zeros((1, 6))
    cylinder = np.array([[-length, 0.0, 0.0, 0.0, 0.0, 0.0, radius, 1.2, 0.9, 1.0]])
    gravity, none, one = np.array([0.0, -9.8, 0.0]), np.zeros(1), np.ones(1)
    run = lambda g, qd, qdd: torques(dh, bodies, inertia, cylinder, g, none, qd, qdd)[0]  # noqa: E731
    mass = 1025.0 * np.pi * radius**2
    assert run(0 * gravity, 2 * one, none) == pytest.approx(1025.0 * 1.2 * radius * 4.0 * length**4 / 4, rel=1e-2)
    assert run(0 * gravity, none, one) == pytest.approx(0.9 * mass * length**3 / 3, rel=1e-2)
    assert run(gravity, none, none) == pytest.approx(-mass * length * 9.8 * length / 2, rel=1e-2)


def _energy(p: Plant, x: Array) -> float:
    mass = np.empty((6, 6))
    mass_matrix(p.dh, p.bodies, p.inertia, p.cylinders, x[2], mass)
    height = sum(
        p.bodies[k, 0] * target(p.dh[: k + 1], x[2:3, : k + 1], p.bodies[k, 1:])[0] @ -p.gravity for k in range(6)
    )
    return float(x[3] @ mass @ x[3] / 2 + p.rotor @ x[1] ** 2 / 2 + p.stiffness @ (x[0] - x[2]) ** 2 / 2 + height)


def test_without_friction_and_currents_energy_stays() -> None:
    none = np.zeros((6, 2))
    p = _plant()._replace(viscous=none, coulomb=none, damping=np.zeros(6))
    x, h = np.zeros((6, 6)), 2e-5
    x[0] = x[2] = [0.3, -0.4, -0.9, 0.2, 0.5, 0.1]
    x[1] = x[3] = [0.5, -0.3, 0.6, 1.0, -0.8, 1.2]
    before, swing = _energy(p, x), 0.0
    mass = np.empty((6, 6))
    for _ in range(4000):
        mass_matrix(p.dh, p.bodies, p.inertia, p.cylinders, x[2] + 0.5 * h * x[3], mass)
        x = step(p, 1.0, x, np.zeros(6), np.linalg.inv(mass), 0.0, 1.0, h)
        swing = max(swing, abs(float(p.rotor @ x[1] ** 2) / 2))
    assert swing > 1.0  # J: the arm falls
    assert abs(_energy(p, x) - before) < 1e-3 * swing


def test_a_healthy_arm_is_rigid_to_within_its_noise() -> None:
    # motor torques from MuJoCo's rigid arm, rotors and the friction of the model file along the motors' angles
    where, p = _where(), _plant()
    motion = simulated(where, p, _short())
    spline = CubicSpline(motion.t, motion.angle)
    # at every step: rows at a multiple of the setpoints' rate would fold their transients onto the motion
    t = motion.t[(motion.t > 0.1) & (motion.t < motion.duration - 0.1)]
    q, qd, qdd = spline(t), spline(t, 1), spline(t, 2)
    model = _in_mujoco(p)
    data = mujoco.MjData(model)
    rigid = np.empty_like(q)
    for row in range(len(t)):
        data.qpos, data.qvel, data.qacc = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(model, data)
        rigid[row] = data.qfrc_inverse
    up = qd > 0
    friction = np.where(up, p.coulomb[:, 0], p.coulomb[:, 1]) * np.tanh(qd / p.rest)
    friction += np.where(up, p.viscous[:, 0], p.viscous[:, 1]) * qd
    current = motion.current[(motion.t > 0.1) & (motion.t < motion.duration - 0.1)]
    b, a = butter(3, 20.0, fs=8000.0)
    error = filtfilt(b, a, current - (rigid + p.rotor * qdd + friction) / p.drive, axis=0)
    # where a joint turns round, friction is not what its speed at one instant says
    moving = minimum_filter1d(np.abs(qd), 961, axis=0) > 0.05
    moving[:1000] = moving[-1000:] = False
    assert np.all(moving.sum(axis=0) > 2000)
    rms = np.sqrt(np.sum(moving * error**2, axis=0) / moving.sum(axis=0))
    assert np.all(rms < 0.2 * where.noise)


def test_size_is_the_change_of_current_over_its_noise() -> None:
    where = _where()
    one = Hidden("current_offset", 2, {"offset": 5.0 * float(where.noise[1])}, 0.0)
    assert strength(where, one, 0.0, (_short(),)) == pytest.approx(5.0, rel=1e-6)

    # two motions are compared, so what hardly changes anything must not count
    nothing = Hidden("base_tilt", None, {"roll": 1e-7, "pitch": 1e-7}, 0.0)
    assert strength(where, nothing, 0.0, (_short(),)) < 0.1
    # and an effect counts as much as its torque: twice the drag is twice the size
    single, double = (
        strength(where, Hidden("hydrodynamic_drag", 1, {"drag": d}, 0.0), 0.0, (_short(),)) for d in (1, 2)
    )
    assert double == pytest.approx(2.0 * single, rel=0.05)


def test_healthy_drives_stay_below_their_limits() -> None:
    # at a limit, integrals wind up, and two motions that differ by a trifle part
    where = laboratory(110)
    plant = plant_of(where, arm_of(where))
    fit, held_out = suite(where.motions, where.seed)
    motion = simulated(where, plant, [*fit, *held_out][0])
    assert np.all(np.abs(motion.current) < 0.8 * plant.limit)


def test_every_name_of_the_catalogue_is_hidden_under_its_own_parameters() -> None:
    by_name = CATALOGUE
    assert set(KINDS) == set(by_name) - CALIBRATION_ONLY - IDENTIFICATION_ONLY
    p, rng = _plant(), np.random.default_rng(2)
    for name, kind in KINDS.items():
        joint = kind.joints[-1] if kind.joints else 1
        values = kind.draw(rng, p, joint, 1.0)
        own = {parameter.name for parameter in by_name[name].parameters}
        assert set(values) - {"place"} <= own, name
        plant, sensing = kind.apply(p, Sensing(), joint, values)
        same = [np.array_equal(a, b) for a, b in zip(plant, p)]
        # dropped triggers come with the rows of one recording
        assert not all(same) or repr(sensing) != repr(Sensing()) or name == "dropped_trigger", name


@pytest.mark.parametrize("name", ["viscous_friction", "coulomb_friction"])
@pytest.mark.parametrize("growth", [0.0, 0.4])
def test_friction_that_is_less_never_drives(name: str, growth: float) -> None:
    """Viscous friction that was four fifths less, and grew by 0.4 of that, drove joint 3."""
    p = _plant()._replace(growth=growth)
    for seed in range(20):
        for joint in KINDS[name].joints:
            values = KINDS[name].draw(np.random.default_rng(seed), p, joint, KINDS[name].most)
            less, _ = KINDS[name].apply(p, Sensing(), joint, values)
            for share in (1.0 - growth, 1.0 + growth):
                assert np.all(less.viscous + share * less.more_viscous[:, None] > 0.0)
                assert np.all(less.coulomb + share * less.more_coulomb[:, None] > 0.0)


def test_a_link_that_is_turned_is_turned_for_currents_and_tracker() -> None:
    """For the tracker alone, currents were those of an arm whose links are where the model has them."""
    p, q, still = _plant(), np.array([0.3, -0.4, 0.2, 0.5, -0.3, 0.1]), np.zeros(6)
    turned, _ = KINDS["link_geometry"].apply(p, Sensing(), 2, {"d_theta": 2e-3, "d_a": 0.0})

    def shown(arm: Plant, at: Array) -> Array:
        load = torques(arm.dh, arm.bodies, arm.inertia, arm.cylinders, arm.gravity, at, still, still)
        return np.concatenate([load, target(arm.dh, at[None], np.array(TARGET))[0]])

    np.testing.assert_allclose(shown(turned, q), shown(p, q + [0.0, 2e-3, 0.0, 0.0, 0.0, 0.0]), rtol=1e-12)
    assert not np.allclose(shown(turned, q)[:6], shown(p, q)[:6], rtol=1e-5)


@pytest.mark.parametrize("counted", [True, False])
def test_servo_and_recorder_miss_the_same_counts(counted: bool) -> None:
    """The recorder missed as many as the servo has parts of them: 2000 times as many."""
    missing, _ = KINDS["missed_counts"].apply(_plant(), Sensing(), 2, {"counts": 22.0, "time": 0.5})
    t = np.array([0.0, 1.0])
    still = SimpleNamespace(t=t, angle=np.zeros((2, 6)))
    read = _angles(missing, still, t, counted)  # type: ignore[arg-type]
    joint = arm_of(_where()).joints[1]
    assert joint.encoder_lines is not None
    count = 2 * np.pi / (4 * joint.encoder_lines * joint.ratio)
    servo = [reading(missing, 1, 0.0, float(time)) for time in t]
    assert np.diff(read[:, 1])[0] == pytest.approx(22 * count, rel=1e-3)
    assert servo[1] - servo[0] == pytest.approx(22 * count, rel=1e-3)


def test_cases_of_a_seed_hide_different_effects() -> None:
    dealt = [name for kind in COUNTS for case in cases(kind, 3) for name, _ in case.effects if name in KINDS]
    assert len(dealt) == len(set(dealt)) == 27


def test_bristles_come_to_the_friction_that_they_stand_for() -> None:
    p = _plant()
    slow = p._replace(bristle=np.full(6, 2e3), bristle_damping=np.zeros(6))
    x, rate = np.zeros((6, 6)), np.empty((6, 6))
    x[1] = x[3] = 0.5
    x[4] = p.coulomb[:, 0] / 2e3
    rates(slow, 1.0, x, np.zeros(6), np.eye(6), 0.0, 1.0, rate)
    plain = np.empty((6, 6))
    rates(p, 1.0, x, np.zeros(6), np.eye(6), 0.0, 1.0, plain)
    np.testing.assert_allclose(rate[1], plain[1], rtol=1e-9)
    np.testing.assert_allclose(rate[4], 0.0, atol=1e-12)


@pytest.mark.parametrize("generator", ["first", "second"])
def test_cases_of_either_generator_come_kind_by_kind_in_turn(generator: str) -> None:
    chosen = drawn(generator, ["singles", "pairs"], 1, 2, ())
    assert [case.kind for case in chosen] == ["singles", "pairs"] * 2


def test_a_spring_that_the_plant_has_is_neither_right_nor_superfluous() -> None:
    """By its effect, its joint and its size within two std; a model that has the springs lacks none."""
    where = replace(laboratory(4), tracker=False, link_encoders=0)
    own = own_springs(where, [3])
    assert [one["joint"] for one in own] == [1, 2, 4, 5, 6]
    assert not own_springs(replace(where, tracker=True), [])

    def named(effect: str, joint: int, stiffness: float) -> Cause:
        estimate = Estimate("stiffness", stiffness, 5e4, "N m/rad")
        return Cause(
            effect=effect,
            joint=joint,
            parameters=[estimate],
            confidence=0.9,
            before=1.0,
            after=0.5,
            group=((effect, joint),),
            evidence="",
            felt_at=joint,
            unit="A",
        )

    told = [named("joint_compliance", 2, 9.2e5), named("joint_compliance", 2, 8.9e5), named("gravity_spring", 2, 1e6)]
    assert [any(is_own(cause, one) for one in own) for cause in told] == [True, False, False]
