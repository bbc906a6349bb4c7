"""The free error of the Coulomb smoothing velocity must not explain what no smoothing can."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.diagnose import diagnose
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
