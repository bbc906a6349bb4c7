"""Strips against the closed form, quadrature and physics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from arm_model import kinematics
from arm_model.description import Arm
from arm_model.dynamics import forward_dynamics
from arm_model.hydrodynamics import (
    Cylinder,
    TwoLinks,
    Water,
    accelerations,
    cylinder_along,
    strip_regressor,
    strip_torque,
)
from arm_model.model_file import read_model
from arm_model.rigid_body import mass_matrix
from inputs import InputError
from tests.arm_model.random_arms import random_arm, random_states

LINKS = TwoLinks((1.0, 0.8), 0.025)


@pytest.fixture(scope="module")
def arm() -> Arm:
    arm = read_model(Path(__file__).resolve().parents[2] / "config/models/underwater.toml")
    first, second = arm.joints
    return replace(arm, joints=(first, replace(second, a=0.8)))


def cylinders(arm: Arm) -> list[Cylinder]:
    return [cylinder_along(arm, 1, 0.025), cylinder_along(arm, 2, 0.025)]


def test_closed_form_is_the_limit_of_the_strips(arm: Arm) -> None:
    q, qd, qdd = random_states(0, 2, 200)
    reversal = LINKS.reversal(q, qd)
    inside = (reversal > 0) & (reversal < 0.8)
    assert 20 < inside.sum() < 180  # both cases are tried
    wanted = LINKS.torque(Water())(q, qd, qdd)
    errors = [
        np.abs(strip_torque(arm, cylinders(arm), Water(), q, qd, qdd, strips=strips) - wanted).max()
        for strips in (50, 100, 1000)
    ]
    assert errors[0] < 2e-3 * np.abs(wanted).max()
    assert errors[1] < errors[0] / 2.5
    assert errors[2] < 1e-5 * np.abs(wanted).max()


@pytest.mark.parametrize("qd", [(1.0, -2.0), (1.0, -1.0), (-0.5, 2.0), (0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (-1.0, 1.4)])
def test_drag_by_quadrature(qd: tuple[float, float]) -> None:
    """Cases by hand: reverse flow, no turning of link 2 (q1' + q2' = 0), one joint alone, rest."""
    water, q2 = Water(), 0.4
    first, second = qd[0] * np.cos(q2), qd[0] + qd[1]

    def drag(l: float, lever: float) -> float:
        v = first + second * l
        return water.drag_per_length(0.025) * abs(v) * v * (l + lever)

    zero = None if second == 0 else [min(max(-first / second, 0.0), 0.8)]
    on_second = quad(drag, 0.0, 0.8, args=(0.0,), points=zero)[0]
    on_first = quad(drag, 0.0, 0.8, args=(np.cos(q2),), points=zero)[0]
    alone = water.drag_per_length(0.025) * abs(qd[0]) * qd[0] / 4
    found = LINKS.drag(water, np.array([[0.3, q2]]), np.array([qd]))[0]
    np.testing.assert_allclose(found, [alone + on_first, on_second], rtol=1e-9, atol=1e-12)


def test_strips_of_any_arm_against_velocities_by_differences() -> None:
    """Drag and added mass of one strip of a random arm, from the motion of its centre by central differences."""
    arm = random_arm(5, joints=3)
    body = Cylinder(3, (0.1, -0.2, 0.3), (0.4, 0.1, 0.2), 0.05)
    q, qd, qdd = (x[:5] for x in random_states(5, 3))
    found = strip_torque(arm, [body], Water(), q, qd, qdd, strips=1, buoyancy=False)
    centre, step = np.array([0.25, -0.05, 0.25, 1.0]), 1e-4

    def place(t: float) -> np.ndarray:
        return kinematics.link_frames(arm, q + qd * t + qdd * t * t / 2)[:, -1] @ centre

    velocity = ((place(step) - place(-step)) / (2 * step))[:, :3]
    acceleration = ((place(step) - 2 * place(0.0) + place(-step)) / step**2)[:, :3]
    span = np.array(body.end) - np.array(body.start)
    length = np.linalg.norm(span)
    axis = kinematics.link_frames(arm, q)[:, -1, :3, :3] @ (span / length)

    def across(v: np.ndarray) -> np.ndarray:
        return v - axis * (v * axis).sum(axis=1, keepdims=True)

    v, a = across(velocity), across(acceleration)
    force = length * 1025.0 * (0.05 * np.linalg.norm(v, axis=1, keepdims=True) * v + 2 * np.pi * 0.05**2 * a)
    jacobian = kinematics.jacobian(arm, q, np.array(centre[:3]))[:, :3]
    np.testing.assert_allclose(found, np.einsum("nij,ni->nj", jacobian, force), rtol=1e-5, atol=1e-4)


def test_drag_takes_energy_away() -> None:
    arm = random_arm(7, joints=4)
    bodies = [Cylinder(j, (0.0, 0.0, 0.0), (0.3, -0.1, 0.2), 0.04) for j in range(1, 5)]
    q, qd, _ = random_states(7, 4, 50)
    tau = strip_torque(arm, bodies, Water(added_mass=0.0), q, qd, np.zeros_like(q), buoyancy=False)
    assert ((tau * qd).sum(axis=1) > 0).all()
    np.testing.assert_allclose(
        strip_torque(arm, bodies, Water(added_mass=0.0), q, -qd, np.zeros_like(q), buoyancy=False), -tau
    )


def test_a_body_as_heavy_as_water_floats() -> None:
    """Gravity and buoyancy cancel where a link is a cylinder of water."""
    arm = random_arm(8, joints=3, friction=False)
    body = Cylinder(3, (0.1, 0.0, 0.0), (0.1, 0.5, 0.0), 0.03)
    mass = 1025.0 * np.pi * 0.03**2 * 0.5
    empty = dict(mass=0.0, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6)
    light = [replace(joint, **empty) for joint in arm.joints]
    light[2] = replace(light[2], mass=mass, com=(0.1, 0.25, 0.0))
    arm = replace(arm, joints=tuple(light))
    from arm_model.rigid_body import rigid_torque

    q = random_states(8, 3)[0]
    none = np.zeros_like(q)
    weight = rigid_torque(arm, q, none, none)
    assert np.abs(weight).max() > 1.0
    np.testing.assert_allclose(weight + strip_torque(arm, [body], Water(), q, none, none), 0.0, atol=1e-9)


def test_coefficients_are_found_again_from_torques(arm: Arm) -> None:
    states = random_states(4, 2)
    measured = LINKS.torque(Water(drag=1.3, added_mass=1.7))(*states)
    columns = strip_regressor(arm, cylinders(arm), 1025.0, *states, strips=400).reshape(-1, 2)
    found = np.linalg.lstsq(columns, measured.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found, [1.3, 1.7], rtol=1e-4)


def test_accelerations_satisfy_the_equation_they_solve(arm: Arm) -> None:
    q, qd, tau = random_states(3, 2)
    around = LINKS.torque(Water())
    qdd = accelerations(arm, around, q, qd, tau)
    left = np.einsum("nij,nj->ni", mass_matrix(arm, q), qdd) + around(q, qd, qdd)
    bias = tau - np.einsum("nij,nj->ni", mass_matrix(arm, q), forward_dynamics(arm, q, qd, tau))
    np.testing.assert_allclose(left + bias, tau, atol=1e-9)
    dry = LINKS.torque(Water(drag=0.0, added_mass=0.0))
    np.testing.assert_allclose(accelerations(arm, dry, q, qd, tau), forward_dynamics(arm, q, qd, tau))


def test_bad_cylinders(arm: Arm) -> None:
    state = np.zeros((1, 2))
    for body, what in (
        (Cylinder(3, (0, 0, 0), (1, 0, 0), 0.1), "no link 3"),
        (Cylinder(1, (0, 0, 0), (0, 0, 0), 0.1), "starts where it ends"),
    ):
        with pytest.raises(InputError, match=what):
            strip_torque(arm, [body], Water(), state, state, state)
