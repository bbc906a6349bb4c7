"""Simulated measurements for these tests: a Puma with random kinematic errors, seen by a tracker.

Uses arm_model's own forward kinematics, which shares no code with the chains that are estimated.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import link_frames
from identification.kinematics.data.runs import Run
from identification.kinematics.models.parameters import as_pose

TARGET = (0.05, 0.0, 0.10)
NOISE = 1e-4


def puma(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


def with_errors(arm: Arm, generator: np.random.Generator, angle: float = 0.01, length: float = 0.002) -> Arm:
    """Every link and the mounting off by normal errors of that size (rad, m).

    Hayati's beta on joint 2, whose axis is parallel.
    """
    joints = []
    for j, joint in enumerate(arm.joints):
        d_angle, d_length = generator.normal(size=3) * angle, generator.normal(size=2) * length
        joints.append(
            replace(
                joint,
                theta=joint.theta + d_angle[0],
                alpha=joint.alpha + d_angle[1],
                beta=joint.beta + (d_angle[2] if j == 1 else 0.0),
                a=joint.a + d_length[0],
                d=joint.d + (0.0 if j == 1 else d_length[1]),
            )
        )
    base = np.array(arm.base)
    base[:3, 3] += generator.normal(size=3) * length
    roll, pitch = generator.normal(size=2) * angle / 3
    tilt = np.array([[1, 0, pitch], [0, 1, -roll], [-pitch, roll, 1]])
    base[:3, :3] = tilt @ base[:3, :3]
    return replace(arm, joints=tuple(joints), base=as_pose(base))


def seen(arm: Arm, q: np.ndarray, target: tuple[float, float, float] = TARGET) -> np.ndarray:
    """(N, 3) where the target is."""
    last = link_frames(arm, q)[:, -1]
    return last[:, :3, :3] @ np.array(target) + last[:, :3, 3]


def limits(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    return np.array([j.limits[0] for j in arm.joints]), np.array([j.limits[1] for j in arm.joints])


def random_poses(arm: Arm, count: int, generator: np.random.Generator) -> np.ndarray:
    low, high = limits(arm)
    return generator.uniform(low, high, (count, len(arm)))


def motion(
    arm: Arm, seconds: float, generator: np.random.Generator, rate: float = 100.0
) -> tuple[np.ndarray, np.ndarray]:
    """t (N,) and q (N, joints): all joints on sines of their own frequency through most of their range."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    low, high = limits(arm)
    q = np.empty((len(t), len(arm)))
    for j in range(len(arm)):
        frequency = 0.06 + 0.04 * j + 0.02 * generator.random()
        swing = np.sin(2 * np.pi * frequency * t + 6 * generator.random())
        q[:, j] = (low[j] + high[j]) / 2 + 0.4 * (high[j] - low[j]) * swing
    return t, q


def sweeps(joints: tuple[int, ...], at: np.ndarray, arc: float, rows: int = 400) -> np.ndarray:
    """q (N, joints): one joint after the other through ``arc`` rad and back to ``at``."""
    q = np.tile(np.asarray(at, float), (rows * len(joints), 1))
    way = arc * (1 - np.cos(2 * np.pi * np.arange(rows) / rows)) / 2
    for k, joint in enumerate(joints):
        q[k * rows : (k + 1) * rows, joint - 1] += way
    return q


def run_of(name: str, t: np.ndarray, q: np.ndarray, xyz: np.ndarray, generator: np.random.Generator) -> Run:
    return Run(name, t, q, xyz + generator.normal(size=xyz.shape) * NOISE)
