"""The free error of the Coulomb smoothing velocity must not explain what no smoothing can, nor follow noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_model import Arm
from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.diagnose import diagnose
from diagnosis.measurements.currents.design_matrix import Library, bounded, dataset_of, free_columns
from diagnosis.measurements.currents.model import Currents
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from identification.selection import Split
from tests.comparison.second_day import motion, puma

HUMP, WIDTH = 38.0, 0.08
"""N m and rad/s at joint 1: half more than all of its Coulomb friction."""


def _recorded(path: Path, root: Path, seed: int) -> Recording:
    arm, rng, t = puma(root, 2), np.random.default_rng(seed), np.arange(3500) / 250.0
    q, qd, qdd = motion(t, 2, seed, 0.8)
    torque = rigid_torque(arm, q, qd, qdd)
    for j, joint in enumerate(arm.joints):
        v = qd[:, j]
        dry = joint.ratio * np.where(v > 0, joint.coulomb[0], joint.coulomb[1])
        dry += HUMP * np.exp(-((v / WIDTH) ** 2)) * (j == 0)
        torque[:, j] += dry * v / np.hypot(v, joint.sign_velocity) + joint.ratio**2 * joint.viscous[0] * v
        torque[:, j] += joint.ratio**2 * joint.rotor_inertia * qdd[:, j]
    i = torque / arm.joint_array("drive_constant") + 0.2 * rng.standard_normal(q.shape)
    write_table(path, t, {"q": np.round(q / 1e-5) * 1e-5, "i": i}, Attachments())
    return open_recording(path)


def test_a_hump_of_friction_is_not_taken_for_another_smoothing(tmp_path: Path, root: Path) -> None:
    runs = [_recorded(tmp_path / f"{seed}.mcap", root, seed) for seed in (1, 2, 3)]
    (cause,) = diagnose(puma(root, 2), runs[:2], runs[2:]).causes
    assert cause.key == ("stribeck_friction", 1)
    found = {p.name: p for p in cause.parameters}
    assert abs(found["breakaway"].value - HUMP) < 2 * found["breakaway"].std
    assert abs(found["stribeck_velocity"].value - WIDTH) < 2 * found["stribeck_velocity"].std


def _to_and_fro(arm: Arm, speed: float, wider: float, noise: float) -> Run:
    """14 s at this speed, rad/s, both ways, of an arm whose friction turns round over ``wider`` times the velocity.

    noise: A against the motion, as correlated noise may be on average over a few moves.
    """
    t, rng = np.arange(3500) / 250.0, np.random.default_rng(3)
    qd = speed * np.tanh(8.0 * np.sin(2 * np.pi * t / 3.5))[:, None] * [1.0, 1.0]
    q, qdd = np.cumsum(qd, axis=0) / 250.0, np.gradient(qd, t, axis=0)
    torque = rigid_torque(arm, q, qd, qdd)
    for j, joint in enumerate(arm.joints):
        v = qd[:, j]
        dry = joint.ratio * np.where(v > 0, joint.coulomb[0], joint.coulomb[1])
        torque[:, j] += dry * v / np.hypot(v, wider * joint.sign_velocity) + joint.ratio**2 * joint.viscous[0] * v
        torque[:, j] += joint.ratio**2 * joint.rotor_inertia * qdd[:, j]
    i = torque / arm.joint_array("drive_constant") + 0.02 * rng.standard_normal(q.shape) - noise * np.sign(qd)
    return residual_run("run", arm, t, np.round(q / 1e-6) * 1e-6, i)


def test_noise_of_fast_moves_says_nothing_of_smoothing_where_a_joint_is_slow(root: Path) -> None:
    """A hundredth of the noise at 1 rad/s was several times the noise at 0.05 rad/s, and viscous friction was named."""
    arm = puma(root, 2)
    for wider, noise, kept in ((1.0, 1e-3, 0), (1.5, 0.0, 2)):
        runs = _to_and_fro(arm, 1.0 if noise else 0.06, wider, noise), _to_and_fro(arm, 0.05, wider, 0.0)
        data = Split(dataset_of(runs[:1]), dataset_of(runs[1:]), False)
        free = [Split(*pair) for pair in zip(free_columns(data.fit, arm), free_columns(data.held_out, arm))]
        data, free = bounded(data, free)
        state = Currents(arm, data, Library((), data), free).start()
        before, after = (float(np.mean(y**2)) for y in (data.held_out.y, state.residual.held_out))
        assert len(state.free) == kept
        assert after < 1.1 * before if noise else after < 0.5 * before
