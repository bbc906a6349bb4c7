"""Arms whose controller reports coupled angles: link angles = C reported angles, torques back by the transpose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm, Coupling, read_model, write_model
from arm_model.description import EffectTerm
from arm_model.effects import described
from arm_model.rigid_body import drive_mass_matrix, link_frames, mass_matrix, rigid_torque
from arm_model.rigid_body.numeric import drive_torque
from arm_model.rigid_body.regressor import parameter_vector, regressor
from arm_model.simulation import simulate
from arm_model.system import inverse_dynamics
from arm_model.urdf import write_urdf

ENTRIES = (Coupling(3, 2, -1.0), Coupling(4, 3, 0.5), Coupling(6, 6, -1.0))


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return replace(read_model(root / "config/models/puma560.toml"), coupling=ENTRIES)


def matrix() -> np.ndarray:
    """Written out by hand."""
    c = np.eye(6)
    c[2, 1], c[3, 2], c[5, 5] = -1.0, 0.5, -1.0
    return c


def states(seed: int = 0) -> tuple[np.ndarray, ...]:
    generator = np.random.default_rng(seed)
    return tuple(scale * generator.normal(size=(20, 6)) for scale in (1.0, 1.5, 4.0))


def test_a_model_file_holds_couplings(arm: Arm, tmp_path: Path) -> None:
    write_model(tmp_path / "m.toml", arm)
    assert "coupling = [" in (tmp_path / "m.toml").read_text()
    assert read_model(tmp_path / "m.toml") == arm
    np.testing.assert_array_equal(arm.coupling_matrix, matrix())


def test_torque_is_that_of_the_links_by_the_transpose_and_of_the_drives_own_motion(arm: Arm) -> None:
    q, qd, qdd = states()
    c = matrix()
    links = rigid_torque(arm, q @ c.T, qd @ c.T, qdd @ c.T) @ c
    drives = np.stack([drive_torque(joint, qd[:, j], qdd[:, j]) for j, joint in enumerate(arm.joints)], axis=-1)
    np.testing.assert_allclose(inverse_dynamics(arm, q, qd, qdd), links + drives, rtol=1e-9, atol=1e-9)


def test_the_regressor_of_coupled_joints_gives_their_torques(arm: Arm) -> None:
    """Columns times parameters equal inverse dynamics, for links, drives and water drag alike."""
    arm = replace(arm, joints=tuple(replace(joint, drag=0.3) for joint in arm.joints))
    q, qd, qdd = states(1)
    columns, _ = regressor(arm, q, qd, qdd)
    torque = inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(columns @ parameter_vector(arm), torque, rtol=1e-8, atol=1e-8)


def test_power_of_the_drives_is_the_rate_of_energy(arm: Arm) -> None:
    q, qd, _ = states(2)
    c = matrix()
    at_drives = np.einsum("ni,nij,nj->n", qd, drive_mass_matrix(arm, q, rotors=False), qd)
    at_links = np.einsum("ni,nij,nj->n", qd @ c.T, mass_matrix(arm, q @ c.T, rotors=False), qd @ c.T)
    np.testing.assert_allclose(at_drives, at_links, rtol=1e-12)


def test_simulated_links_stand_where_the_motors_put_them(arm: Arm) -> None:
    def swing(t: np.ndarray) -> np.ndarray:
        return 0.3 * np.sin(2.0 * t)[:, None] * np.ones(6)

    motion = simulate(arm, swing, duration=0.4, rate=250)
    np.testing.assert_allclose(motion.q, motion.qm @ matrix().T, atol=1e-12)
    coupled = replace(arm, effects=(EffectTerm("wrist_coupling", None, {"c54": 0.1}),))
    motion = simulate(coupled, swing, duration=0.1, rate=250)
    c = matrix()
    c[4, 3] = 0.1
    np.testing.assert_allclose(motion.q, motion.qm @ c.T, atol=1e-12)


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        ((Coupling(7, 2, 1.0),), "joint 7 does not exist"),
        ((Coupling(3, 2, 1.0), Coupling(3, 2, 0.5)), "same joint and by"),
        ((Coupling(3, 3, 0.0),), "singular"),
    ],
)
def test_impossible_couplings_are_refused_in_one_line(root: Path, tmp_path: Path, entries, reason: str) -> None:
    text = (root / "config/models/puma560.toml").read_text()
    for entry in entries:
        text += f"\n[[coupling]]\njoint = {entry.joint}\nby = {entry.by}\nratio = {entry.ratio}\n"
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(InputError, match=reason) as caught:
        read_model(tmp_path / "m.toml")
    assert "\n" not in str(caught.value)


def test_what_cannot_hold_couplings_refuses_them(arm: Arm, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no place for \[\[coupling\]\]"):
        write_urdf(tmp_path / "arm.urdf", arm)
    assert not (tmp_path / "arm.urdf").exists()


@pytest.mark.parametrize("joint", [1, 2, 6])
def test_a_moved_zero_displaces_every_link_that_the_motor_moves(arm: Arm, joint: int) -> None:
    reported = states(3)[0]
    moved = described(arm.with_effect("joint_zero_offset", joint, offset=0.3))
    true = reported - 0.3 * (np.arange(1, 7) == joint)
    expected = link_frames(arm, arm.link_angles(true))
    np.testing.assert_allclose(link_frames(moved, moved.link_angles(reported)), expected, atol=1e-12)


def test_an_arm_without_couplings_does_not_get_the_equations_of_one_with_them(arm: Arm) -> None:
    """Compiled equations are kept within a process."""
    pose = np.array([0.3, 0.5, -1.0, 0.2, 0.5, -0.3])
    for each in (arm, replace(arm, coupling=())):
        motion = simulate(each, lambda t: np.tile(pose, (len(t), 1)), duration=0.1, rate=100)
        np.testing.assert_allclose(motion.q, np.tile(each.link_angles(pose), (len(motion.t), 1)), atol=1e-9)
