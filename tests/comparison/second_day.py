"""Recordings of an arm on two days, written out by hand: rigid links, and friction as arms have it.

The friction is none of armscope's laws: a constant, a hump near rest, and |v|^0.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Attachments, Recording, open_recording, write_table
from tests.arm_model.pumas import three_links

LEVELS = (20.0, 10.0, 6.0)
"""N m of constant friction per joint on the first day."""
HUMP, STRIBECK, POWER = 2.0, 0.05, 3.0
"""N m at rest above the constant, rad/s over which it decays, N m at 1 rad/s."""


def puma(root: Path, joints: int = 3) -> Arm:
    """The first links of the Puma, without controller."""
    arm = replace(three_links(read_model(root / "config/models/puma560.toml")), controller=None)
    return replace(arm, joints=arm.joints[:joints])


def friction(v: np.ndarray, level: float, turn: float = 0.0) -> np.ndarray:
    """N m that oppose a motion of v rad/s, and turn with its direction in a step, or within ``turn`` rad/s."""
    speed = np.abs(v)
    direction = v / np.hypot(v, turn) if turn else np.sign(v)
    return direction * (level + HUMP * np.exp(-((speed / STRIBECK) ** 2)) + POWER * speed**0.6)


def motion(t: np.ndarray, joints: int, seed: int, speed: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m, J) angle, speed, acceleration: five harmonics of 0.1 Hz per joint, ``speed`` times as fast."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * 0.1 * speed * np.arange(1, 6)
    a, b = rng.normal(size=(2, 3, 5)) * np.array([0.35, 0.3, 0.4])[:, None] / np.arange(1, 6) ** 0.7
    phase = w * t[:, None]
    q = np.cos(phase) @ a.T + np.sin(phase) @ b.T + np.array([0.0, -0.5, 0.6])
    qd = -np.sin(phase) @ (a * w).T + np.cos(phase) @ (b * w).T
    qdd = -np.cos(phase) @ (a * w**2).T - np.sin(phase) @ (b * w**2).T
    return q[:, :joints], qd[:, :joints], qdd[:, :joints]


def record(
    path: Path,
    arm: Arm,
    noise: int,
    *,
    seed: int = 0,
    levels: Sequence[float] = LEVELS,
    speed: float = 1.0,
    seconds: float = 20.0,
    rate: float = 250.0,
    resting: int | None = None,
    temp: float | None = None,
    experiment: str | None = None,
    by_load: float = 0.0,
    ripple: tuple[float, float, float] = (0.0, 1.0, 0.0),
    spring: float = 0.0,
    limit: float = np.inf,
    tilt: tuple[float, float] = (0.0, 0.0),
    zeros: Sequence[float] = (),
    reach: float = 1.0,
    late: float = 0.0,
    soft: float = 0.0,
    turn: float = 0.0,
    step: float = 1e-5,
) -> Recording:
    """Encoders of ``step`` rad; currents with white noise of 10 mA and as much that is correlated over 20 rows.

    seed, noise  of the motion and of the noise; resting: a joint (from 0) that stands still;
                 by_load: share of the load of joint 2 that is added to its friction
    ripple       of joint 1: N m, cycles per turn of the joint, rad; spring: N m/rad at joint 2, at rest at 0.4 rad;
                 limit: A that the current of joint 1 does not exceed
    tilt         rad by which the base is turned about its x, then about its y axis
    zeros        (J,) rad that the encoders read where the links are at 0
    reach        factor of the motion of joint 1
    late         s by which the currents are read later than the encoders
    soft         rad/(N m) of the gear of joint 1, by which its motor leads its link, without delay
    turn         rad/s within which friction turns at a reversal; 0: it steps
    """
    t = np.arange(int(rate * seconds)) / rate
    q, qd, qdd = motion(t - late, len(arm), seed, speed)
    seen = motion(t, len(arm), seed, speed)[0]
    for each in (q, qd, qdd, seen):
        each[:, 0] *= reach
    if resting is not None:
        q[:, resting], qd[:, resting], qdd[:, resting] = seen[0, resting], 0.0, 0.0
        seen[:, resting] = seen[0, resting]
    roll, pitch = (Rotation.from_euler(axis, angle) for axis, angle in zip("xy", tilt))
    level = arm.gravity
    # what the base feels: the world's gravity seen from the turned frame
    arm = replace(arm, gravity=tuple((pitch * roll).inv().apply(level).tolist()))
    torque = rigid_torque(arm, q, qd, qdd)
    torque[:, 1] += by_load * np.abs(torque[:, 1]) * np.sign(qd[:, 1])
    lead = soft * torque[:, 0]
    seen[:, 0] += lead
    qd[:, 0] += np.gradient(lead, t)
    qdd[:, 0] += np.gradient(np.gradient(lead, t), t)
    for j, joint in enumerate(arm.joints):
        torque[:, j] += joint.ratio**2 * joint.rotor_inertia * qdd[:, j] + friction(qd[:, j], levels[j], turn)
    torque[:, 0] += ripple[0] * np.sin(ripple[1] * q[:, 0] + ripple[2])
    torque[:, 1 % len(arm)] += spring * (q[:, 1 % len(arm)] - 0.4)
    white, driven = np.random.default_rng(noise).standard_normal((2, *q.shape))
    i = torque / arm.joint_array("drive_constant")
    i[:, 0] = np.clip(i[:, 0], -limit, limit)
    i += 0.01 * white + 0.01 * lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], driven, axis=0)
    read = seen + np.asarray(zeros) if len(zeros) else seen
    signals = {"q": np.round(read / step) * step, "i": i}
    if temp is not None:
        signals["temp"] = np.full_like(q, temp)
    write_table(path, t, signals, Attachments(experiment=experiment))
    return open_recording(path)
