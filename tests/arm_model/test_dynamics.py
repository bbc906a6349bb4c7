"""Identities on random arms, and MuJoCo as an independent oracle."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model
from arm_model.parameters import parameter, with_parameters
from arm_model.rigid_body import kinematics, numeric
from arm_model.rigid_body.regressor import parameter_vector, regressor
from arm_model.system import dynamics
from tests.arm_model.mujoco_arms import mujoco_model
from tests.arm_model.oracles import energy_of, forward_dynamics
from tests.arm_model.random_arms import in_water, random_arm, random_states

SEEDS = range(12)
WET = pytest.mark.parametrize("wet", [False, True], ids=["in air", "in water"])


def an_arm(seed: int, wet: bool) -> Arm:
    return in_water(random_arm(seed), seed) if wet else random_arm(seed)


@WET
@pytest.mark.parametrize("seed", SEEDS)
def test_regressor_times_parameters_is_inverse_dynamics(seed: int, wet: bool) -> None:
    arm = an_arm(seed, wet)
    q, qd, qdd = random_states(seed, len(arm))
    columns, names = regressor(arm, q, qd, qdd)
    assert columns.shape == (len(q), len(arm), len(names))
    np.testing.assert_allclose(columns @ parameter_vector(arm), dynamics.inverse_dynamics(arm, q, qd, qdd), atol=1e-9)
    np.testing.assert_allclose(parameter_vector(arm), [parameter(arm, name) for name in names], atol=1e-12)


@WET
@pytest.mark.parametrize("seed", SEEDS)
def test_forward_undoes_inverse_and_mass_matrix_is_positive(seed: int, wet: bool) -> None:
    arm = an_arm(seed, wet)
    q, qd, qdd = random_states(seed, len(arm))
    tau = dynamics.inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(forward_dynamics(arm, q, qd, tau), qdd, atol=1e-8)
    matrix = numeric.mass_matrix(arm, q)
    np.testing.assert_allclose(matrix, np.swapaxes(matrix, 1, 2), atol=1e-12)
    assert (np.linalg.eigvalsh(matrix) > 0).all()


@WET
@pytest.mark.parametrize("seed", SEEDS)
def test_mass_matrix_is_what_accelerations_cost(seed: int, wet: bool) -> None:
    arm = an_arm(seed, wet)
    q, qd, qdd = random_states(seed, len(arm))
    still = numeric.rigid_torque(arm, q, qd, 0 * qdd)
    inertial = np.einsum("nij,nj->ni", numeric.mass_matrix(arm, q, rotors=False), qdd)
    np.testing.assert_allclose(numeric.rigid_torque(arm, q, qd, qdd) - still, inertial, atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_power_balance(seed: int) -> None:
    """The power of the torques of a frictionless arm is the rate of its energy (by central differences)."""
    arm = random_arm(seed, friction=False)
    q, qd, qdd = random_states(seed, len(arm))
    step = 1e-5
    ahead = energy_of(arm, q + step * qd + step**2 / 2 * qdd, qd + step * qdd)
    behind = energy_of(arm, q - step * qd + step**2 / 2 * qdd, qd - step * qdd)
    power = np.sum(dynamics.inverse_dynamics(arm, q, qd, qdd) * qd, axis=1)
    np.testing.assert_allclose((ahead - behind) / (2 * step), power, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("seed", SEEDS)
def test_jacobian_is_the_derivative_of_forward(seed: int) -> None:
    arm = random_arm(seed)
    q, _, _ = random_states(seed, len(arm), 3)
    step = 1e-6
    for j in range(len(arm)):
        nudge = step * np.eye(len(arm))[j]
        ahead, behind = kinematics.forward(arm, q + nudge), kinematics.forward(arm, q - nudge)
        slope = (ahead[:, :3, 3] - behind[:, :3, 3]) / (2 * step)
        np.testing.assert_allclose(kinematics.jacobian(arm, q)[:, :3, j], slope, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_agrees(seed: int) -> None:
    mujoco = pytest.importorskip("mujoco")
    arm = random_arm(seed, friction=False)
    model = mujoco_model(arm)
    data = mujoco.MjData(model)
    states = random_states(seed, len(arm), 5)
    ours = numeric.rigid_torque(arm, *states)
    for q, qd, qdd, expected in zip(*states, ours):
        data.qpos, data.qvel, data.qacc = q, qd, qdd
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(expected, data.qfrc_inverse, rtol=1e-8, atol=1e-8)


def test_changed_parameters_act_linearly() -> None:
    arm = random_arm(3)
    q, qd, qdd = random_states(3, len(arm))
    columns, names = regressor(arm, q, qd, qdd)
    changes = {
        "link2.mass": 4.0,
        "link2.mx": 0.3,
        "link4.ixy": 0.01,
        "joint1.viscous_positive": 5.0,
        "joint3.coulomb_negative": 2.0,
    }
    changed = with_parameters(arm, changes)
    p = parameter_vector(arm)
    for name, value in changes.items():
        p[names.index(name)] = value
    np.testing.assert_allclose(columns @ p, dynamics.inverse_dynamics(changed, q, qd, qdd), atol=1e-9)


def test_uneven_friction_is_the_same_as_effect_and_in_the_description() -> None:
    arm = random_arm(3)
    joint = replace(arm.joints[1], viscous=(0.0, 0.0), coulomb=(0.0, 0.0))
    bare = replace(arm, joints=(arm.joints[0], joint, *arm.joints[2:]))
    n = joint.ratio
    missing = {"positive": 3.0, "negative": 2.0, "viscous_positive": 1.5, "viscous_negative": 4.0}
    effect = replace(bare, effects=(EffectTerm("friction_asymmetry", 2, missing),))
    joint = replace(joint, viscous=(1.5 / n**2, 4.0 / n**2), coulomb=(3.0 / n, 2.0 / n))
    described = replace(bare, joints=(arm.joints[0], joint, *arm.joints[2:]))
    states = random_states(3, len(arm))
    np.testing.assert_allclose(
        dynamics.inverse_dynamics(effect, *states), dynamics.inverse_dynamics(described, *states), atol=1e-9
    )


@pytest.mark.parametrize("name", ["puma560", "puma560_worn"])
def test_many_rows_take_the_memory_of_few_and_give_the_same(root: Path, name: str) -> None:
    arm = read_model(root / f"config/models/{name}.toml")
    q, qd, qdd = random_states(3, len(arm), count=4 * numeric.BLOCK + 5)
    time = np.linspace(0.0, 60.0, len(q))
    dynamics.inverse_dynamics(arm, q[:2], qd[:2], qdd[:2], time=time[:2])  # its equations are made once
    tracemalloc.start()
    torque, matrix = dynamics.inverse_dynamics(arm, q, qd, qdd, time=time), numeric.mass_matrix(arm, q)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * (torque.nbytes + matrix.nbytes) + 600 * 8 * numeric.BLOCK
    some = np.random.default_rng(0).choice(len(q), 40)
    found = dynamics.inverse_dynamics(arm, q[some], qd[some], qdd[some], time=time[some])
    np.testing.assert_allclose(torque[some], found, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(matrix[some], numeric.mass_matrix(arm, q[some]), rtol=1e-12, atol=1e-12)
    at_rest = (
        dynamics.inverse_dynamics(arm, q, np.zeros((1, len(arm))), np.zeros((1, len(arm)))) if not arm.effects else None
    )
    if at_rest is not None:
        np.testing.assert_allclose(at_rest, dynamics.inverse_dynamics(arm, q, 0 * q, 0 * q), atol=1e-12)
