"""Friction of a joint's own axis, which several motors turn where joints are coupled: an oracle written out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm, Coupling, read_model, write_model
from arm_model.rigid_body import mass_matrix
from arm_model.rigid_body.regressor import parameter_vector, regressor
from arm_model.simulation import simulate
from arm_model.system import inverse_dynamics
from arm_model.urdf import read_urdf, write_urdf
from tests.arm_model.oracles import forward_dynamics

WRIST = {"c54": 0.11, "c64": -0.07, "c65": 0.19}
VISCOUS, COULOMB = {4: 0.4, 5: 0.3}, {4: 0.9, 5: 0.7}
"""Of joint from 0, N m s/rad and N m."""


def matrix() -> np.ndarray:
    """Link rates over motor rates of the coupled wrist."""
    c = np.eye(6)
    c[4, 3], c[5, 3], c[5, 4] = WRIST["c54"], WRIST["c64"], WRIST["c65"]
    return c


@pytest.fixture(scope="module")
def plain(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.fixture(scope="module")
def coupled(plain: Arm) -> Arm:
    """The wrist of the Puma, coupled by entries of the arm's matrix."""
    entries = (Coupling(5, 4, WRIST["c54"]), Coupling(6, 4, WRIST["c64"]), Coupling(6, 5, WRIST["c65"]))
    return replace(plain, coupling=entries)


def rubbing(arm: Arm) -> Arm:
    """The arm with friction of the axes of joints 5 and 6."""
    own = [
        replace(joint, link_viscous=VISCOUS.get(j), link_coulomb=COULOMB.get(j)) for j, joint in enumerate(arm.joints)
    ]
    return replace(arm, joints=tuple(own))


def by_hand(arm: Arm, qd: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(N, 6) N m that the motors bear in addition: C^T tau(C q')."""
    links, torque = qd @ c.T, np.zeros_like(qd)
    for j, viscous in VISCOUS.items():
        v = links[:, j]
        torque[:, j] = viscous * v + COULOMB[j] * v / np.sqrt(v**2 + arm.joints[j].sign_velocity ** 2)
    return torque @ c


def states(seed: int) -> tuple[np.ndarray, ...]:
    generator = np.random.default_rng(seed)
    return tuple(scale * generator.normal(size=(30, 6)) for scale in (1.0, 0.7, 4.0))


@pytest.mark.parametrize("kind", ["none", "matrix", "effect"])
def test_motors_bear_the_friction_of_every_axis_that_they_turn(plain: Arm, coupled: Arm, kind: str) -> None:
    arm = {"none": plain, "matrix": coupled, "effect": plain.with_effect("wrist_coupling", **WRIST)}[kind]
    c = np.eye(6) if kind == "none" else matrix()
    q, qd, qdd = states(1)
    more = inverse_dynamics(rubbing(arm), q, qd, qdd) - inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(more, by_hand(arm, qd, c), rtol=1e-9, atol=1e-9)


def test_the_regressor_of_friction_of_links_gives_their_torques(coupled: Arm) -> None:
    arm, (q, qd, qdd) = rubbing(coupled), states(2)
    for friction in ("symmetric", "asymmetric"):
        even = replace(arm, joints=tuple(replace(joint, coulomb=sum(joint.coulomb) / 2) for joint in arm.joints))
        columns, names = regressor(even, q, qd, qdd, friction=friction)
        assert {"joint5.link_viscous", "joint6.link_coulomb"} <= set(names)
        np.testing.assert_allclose(
            columns @ parameter_vector(even, friction=friction),
            inverse_dynamics(even, q, qd, qdd),
            rtol=1e-8,
            atol=1e-8,
        )


def test_the_work_of_the_drives_is_energy_and_what_the_axes_take(coupled: Arm) -> None:
    """Without gravity and friction of drives, by quadrature along a simulated motion."""
    free = [replace(j, viscous=0.0, coulomb=0.0, offset=0.0, sign_velocity=0.05) for j in coupled.joints]
    arm = rubbing(replace(coupled, joints=tuple(free), gravity=(0.0, 0.0, 0.0), controller=None))
    drive = arm.joint_array("drive_constant")
    size = np.array([4.0, 4.0, 3.0, 1.5, 2.5, 2.0]) / drive

    def currents(t: np.ndarray) -> np.ndarray:
        return size * np.sin(4.0 * np.asarray(t)[:, None] + np.arange(6))

    motion = simulate(arm, currents, duration=1.0, rate=2000)
    rates = np.gradient(motion.qm, motion.t, axis=0)
    links = rates @ matrix().T
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", links, mass_matrix(arm, motion.q, rotors=False), links)
    kinetic += 0.5 * rates**2 @ (arm.joint_array("ratio") ** 2 * arm.joint_array("rotor_inertia"))
    power = np.sum(rates * (motion.current * drive - by_hand(arm, rates, matrix())), axis=1)
    lost = np.sum(rates * by_hand(arm, rates, matrix()), axis=1).mean() * motion.t[-1]
    gained = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(motion.t))])
    assert lost > 0.2 * kinetic.max()
    np.testing.assert_allclose(kinetic[5:-5] - gained[5:-5], 0.0, atol=3e-3 * lost)


def test_forward_dynamics_inverts_it(coupled: Arm) -> None:
    arm, (q, qd, qdd) = rubbing(coupled), states(3)
    np.testing.assert_allclose(
        forward_dynamics(arm, q, qd, inverse_dynamics(arm, q, qd, qdd)), qdd, rtol=1e-7, atol=1e-7
    )


def test_a_model_file_holds_it_and_refuses_what_drives_the_joint(coupled: Arm, tmp_path: Path) -> None:
    write_model(tmp_path / "arm.toml", rubbing(coupled))
    assert read_model(tmp_path / "arm.toml") == rubbing(coupled)
    text = (tmp_path / "arm.toml").read_text().replace("link_coulomb = 0.9", "link_coulomb = -0.9")
    (tmp_path / "arm.toml").write_text(text)
    with pytest.raises(InputError, match="link_coulomb"):
        read_model(tmp_path / "arm.toml")


def test_urdf_has_the_sum_of_both(plain: Arm, tmp_path: Path) -> None:
    write_urdf(tmp_path / "arm.urdf", rubbing(plain))
    joint, written = plain.joints[4], read_urdf(tmp_path / "arm.urdf").joints[4]
    assert written.ratio * written.coulomb[0] == pytest.approx(joint.ratio * sum(joint.coulomb) / 2 + COULOMB[4])
    assert written.ratio**2 * written.viscous[0] == pytest.approx(joint.ratio**2 * sum(joint.viscous) / 2 + VISCOUS[4])
