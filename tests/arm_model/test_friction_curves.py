"""Friction of free shape: identities, an independent integration, and the published laws that it must represent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_io import InputError
from arm_model import Arm, FrictionCurve, Joint, parameter, read_model, with_parameters, write_model
from arm_model.effects import dissipation
from arm_model.friction_split import split
from arm_model.rigid_body import numeric
from arm_model.rigid_body.friction_curve import total_at
from arm_model.rigid_body.regressor import parameter_vector, regressor
from arm_model.simulation import simulate, simulate_at, simulate_batch, system_of
from arm_model.symbolic.printing import PYTHON, PYTHON_FUNCTIONS, assignments, shown
from arm_model.symbolic.tape import evaluate
from arm_model.system import dynamics
from arm_model.system.inverse import torque_with_effects
from arm_model.urdf import read_urdf
from armscope.cli import run
from tests.arm_model.oracles import forward_dynamics
from tests.arm_model.random_arms import random_arm, random_states

PANDA = (
    np.array([0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489]),
    np.array([5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336]),
    np.array([0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526]),
)
"""Coefficients of the sigmoid of each joint: Gaz et al., IEEE RA-L 4(4), 2019, table III."""


def curved(seed: int) -> Arm:
    """A random arm with a random curve at every joint but the first."""
    arm, rng = random_arm(seed), np.random.default_rng(seed + 3000)

    def curve() -> FrictionCurve:
        speed = np.sort(rng.uniform(0.0, 1.5, 5)) * [rng.integers(0, 2), 1, 1, 1, 1]
        return FrictionCurve(*(tuple(map(float, v)) for v in (speed, rng.uniform(0, 3, 5), rng.uniform(0, 3, 5))))

    return replace(arm, joints=(arm.joints[0], *(replace(j, friction_curve=curve()) for j in arm.joints[1:])))


@pytest.mark.parametrize("seed", range(4))
def test_regressor_tape_and_numbers_agree(seed: int) -> None:
    arm = curved(seed)
    q, qd, qdd = random_states(seed, len(arm))
    torque = dynamics.inverse_dynamics(arm, q, qd, qdd)
    columns, names = regressor(arm, q, qd, qdd)
    np.testing.assert_allclose(columns @ parameter_vector(arm), torque, atol=1e-9)
    np.testing.assert_allclose(parameter_vector(arm), [parameter(arm, name) for name in names], atol=1e-12)
    np.testing.assert_allclose(torque_with_effects(arm, q, qd, qdd, np.zeros(len(q))), torque, atol=1e-9)
    np.testing.assert_allclose(forward_dynamics(arm, q, qd, torque), qdd, atol=1e-8)


def test_symmetric_columns_are_those_of_both_directions() -> None:
    arm = curved(1)
    q, qd, qdd = random_states(1, len(arm))
    both, names = regressor(arm, q, qd, qdd, friction="symmetric")
    each, directed = regressor(arm, q, qd, qdd)
    for k, name in enumerate(names):
        if ".curve" in name:
            sides = [each[:, :, directed.index(f"{name}_{way}")] for way in ("positive", "negative")]
            np.testing.assert_allclose(both[:, :, k], sides[0] + sides[1], atol=1e-12)


def test_a_curve_at_two_speeds_is_viscous_and_coulomb_friction() -> None:
    straight = Joint(mass=1.0, coulomb=(3.0, 2.0), viscous=(5.0, 4.0), sign_velocity=1e-9)
    curve = FrictionCurve((0.0, 2.0), (3.0, 13.0), (2.0, 10.0))
    by_curve = replace(straight, coulomb=(0.0, 0.0), viscous=(0.0, 0.0), friction_curve=curve)
    v = np.linspace(-2, 2, 41)[:, None]
    one, other = (dynamics.inverse_dynamics(Arm("arm", (j,)), 0 * v, v, 0 * v) for j in (straight, by_curve))
    np.testing.assert_allclose(one, other, atol=1e-7)


def test_values_of_a_curve_by_name_and_in_a_batch() -> None:
    arm = curved(2)
    assert parameter(with_parameters(arm, {"joint2.curve3": 7.0}), "joint2.curve3_negative") == 7.0
    assert parameter(with_parameters(arm, {"joint2.curve1_positive": 7.0}), "joint2.curve1_positive") == 7.0
    for unknown in ("joint2.curve6", "joint2.curve0", "joint1.curve1"):
        with pytest.raises(InputError):
            parameter(arm, unknown)
    arm = Arm("wheel", (Joint(inertia=(1, 1, 1, 0, 0, 0), friction_curve=FrictionCurve((0.1, 1.0), (1, 1), (2, 1))),))
    values, times = np.array([0.5, 1.0, 3.0]), np.linspace(0, 1, 11)

    def current(t: np.ndarray) -> np.ndarray:
        return np.full((len(t), 1), 4.0)

    batch = simulate_batch(arm, current, times, parameters={"joint1.curve2": values})
    for lane, value in enumerate(values):
        one = simulate(with_parameters(arm, {"joint1.curve2": value}), current, duration=1.0, rate=10.0)
        np.testing.assert_allclose(batch.q[lane], one.q, atol=1e-9)


def test_a_wheel_runs_out_as_an_independent_integration_says() -> None:
    """A hump, then a power of the speed: integrated by scipy with a table look-up of its own."""
    speed, torque = (0.01, 0.05, 0.2, 0.6, 2.0), (1.2, 0.7, 0.8, 1.1, 2.0)
    joint = Joint(inertia=(0.3, 0.3, 0.3, 0, 0, 0), friction_curve=FrictionCurve(speed, torque, torque))
    driven = 2.5

    def rate(t: float, state: np.ndarray) -> list[float]:
        v = state[1]
        push = driven if t < 0.5 else 0.0
        return [v, (push - v / np.hypot(v, 0.01) * np.interp(abs(v), speed, torque)) / 0.3]

    def current(t: np.ndarray) -> np.ndarray:
        return np.where(t < 0.5, driven, 0.0)[:, None]

    times = np.linspace(0.0, 2.0, 41)
    ours = simulate_at(Arm("wheel", (joint,)), current, times).q[:, 0]
    theirs = solve_ivp(rate, (0, 2), [ours[0], 0.0], t_eval=times, rtol=1e-9, atol=1e-11, max_step=1e-3).y[0]
    assert np.ptp(theirs) > 0.5
    np.testing.assert_allclose(ours, theirs, atol=2e-4 * np.ptp(theirs))


def test_printed_equations_evaluate_to_the_same() -> None:
    system = system_of(curved(3))
    inputs = {node.name for node in system.tape.nodes if node.operation == "input"}
    values = dict(zip(sorted(inputs), np.random.default_rng(0).uniform(0.1, 1.0, len(inputs))))
    names = {name: shown(name).replace(".", "_") for name in inputs}
    assert len(set(names.values())) == len(inputs)
    lines, outputs = assignments(system.tape, {"torque": system.drag[2]}, PYTHON, names)
    space = {name: getattr(np, name) for name in PYTHON_FUNCTIONS} | {names[name]: v for name, v in values.items()}
    exec("\n".join(lines), space)
    assert eval(outputs["torque"], space) == pytest.approx(evaluate(system.tape, [system.drag[2]], values)[0])


def test_models_with_curves_come_back_from_their_files(tmp_path: Path) -> None:
    write_model(tmp_path / "arm.toml", curved(4))
    assert read_model(tmp_path / "arm.toml") == curved(4)


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("speed = [0.0, 0.5, 0.5]\npositive = [1, 1, 1]\nnegative = [1, 1, 1]", "must increase"),
        ("speed = [-0.1, 0.5, 0.6]\npositive = [1, 1, 1]\nnegative = [1, 1, 1]", "greater than or equal to 0"),
        ("speed = [0.1]\npositive = [1]\nnegative = [1]", "at least 2"),
        ("speed = [0.1, 0.5]\npositive = [1, 1, 1]\nnegative = [1, 1]", "has 3 entries, speed has 2"),
        ("speed = [0.1, 0.5]\npositive = [1, 1]", "negative"),
        ("speed = [0.1, 0.5]\npositive = [1, -0.5]\nnegative = [1, 1]", "its friction"),
    ],
)
def test_wrong_curves_are_refused_in_one_line(tmp_path: Path, entry: str, sentence: str) -> None:
    body = 'type = "revolute"\nmass = 1.0\ncom = [0.0, 0.0, 0.1]\ninertia = [1, 1, 1, 0, 0, 0]'
    text = f'name = "arm"\nunits = "SI"\n[[joint]]\n{body}\n[joint.friction_curve]\n{entry}\n'
    (tmp_path / "arm.toml").write_text(text)
    with pytest.raises(InputError, match=sentence) as error:
        read_model(tmp_path / "arm.toml")
    assert "\n" not in str(error.value)


def test_a_negative_value_is_no_fault_where_the_total_opposes_the_motion() -> None:
    curve = FrictionCurve((0.0, 0.2, 1.0), (0.5, -0.8, 0.0), (0.5, -0.8, 0.0))
    arm = Arm("arm", (Joint(coulomb=(1.0, 1.0), friction_curve=curve),))
    assert not dissipation.driven(arm)
    slack = replace(arm, joints=(replace(arm.joints[0], coulomb=(0.7, 1.0)),))
    assert dissipation.driven(slack) == [0]
    assert dissipation.least_friction(slack, 0) == (pytest.approx(0.2), pytest.approx(-0.1))
    assert not dissipation.driven(dissipation.dissipative(slack))


def _through(law: np.ufunc | object, speed: np.ndarray) -> FrictionCurve:
    return FrictionCurve(*(tuple(map(float, v)) for v in (speed, law(speed), -law(-speed))))  # type: ignore[operator]


def _hump(v: np.ndarray) -> np.ndarray:
    return np.sign(v) * (4.0 + 2.0 * np.abs(v) ** 0.6 + 1.0 * np.exp(-((v / 0.06) ** 2)))


@pytest.mark.parametrize("joint", range(-1, 7))
def test_published_laws_are_within_two_percent_of_a_curve_through_fourteen_speeds(joint: int) -> None:
    if joint < 0:
        law = _hump
    else:
        size, slope, shift = (values[joint] for values in PANDA)

        def law(v: np.ndarray) -> np.ndarray:
            return size / (1 + np.exp(-slope * (v + shift))) - size / (1 + np.exp(-slope * shift))

    curve = _through(law, np.append(0.0 if joint >= 0 else 0.002, np.geomspace(0.02, 2.0, 13)))
    joint_with = Joint(friction_curve=curve, sign_velocity=1e-9)
    v = np.concatenate([-np.geomspace(0.002, 2.0, 400), np.geomspace(0.002, 2.0, 400)])[:, None]
    torque = dynamics.inverse_dynamics(Arm("arm", (joint_with,)), 0 * v, v, 0 * v)
    assert np.abs(torque - law(v)).max() < 0.02 * np.abs(law(v)).max()


def test_beyond_its_last_speed_friction_continues_as_it_rose_before() -> None:
    # an arm whose friction turns abruptly, by a model in which it turns within 10 mm/s: the curve makes up for that
    speed, smoothing = np.geomspace(0.001, 0.145, 18), 0.01

    def law(v: np.ndarray) -> np.ndarray:
        return 17.0 + 30.0 * v**0.6

    values = tuple((law(speed) / np.tanh(speed / smoothing)).tolist())
    whole = Joint(friction_curve=FrictionCurve(tuple(speed.tolist()), values, values), sign_velocity=smoothing)
    divided = split(whole)
    inside, outside = np.geomspace(0.002, 0.145, 50), np.linspace(0.15, 0.2, 10)
    assert np.allclose(total_at(divided, inside), total_at(whole, inside), rtol=1e-9)
    # by the line nearest in torque up to 12 % below
    assert np.allclose(total_at(divided, outside)[0], law(outside), rtol=0.03)


def test_urdf_export_says_what_it_cannot_express(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = curved(5)
    write_model(tmp_path / "arm.toml", arm)
    assert run(["model", str(tmp_path / "arm.toml"), "--out", str(tmp_path / "arm.urdf")]) == 0
    said = capsys.readouterr().err
    for number in range(2, len(arm) + 1):
        assert f"friction of joint {number} has a friction curve; URDF has one Coulomb" in said
    back = read_urdf(tmp_path / "arm.urdf")
    for joint, exported in zip(arm.joints[1:], back.joints[1:]):
        assert joint.friction_curve is not None
        top = joint.friction_curve.speed[-1]
        v = np.array([-top, -top / 2, top / 2, top])
        straight = v * exported.viscous[0] * exported.ratio**2 + np.sign(v) * exported.coulomb[0] * exported.ratio
        whole = numeric.drive_torque(replace(joint, offset=0.0), v, 0.0)
        assert np.abs(straight - whole).max() < np.abs(whole).max()
