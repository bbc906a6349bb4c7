"""A two-link arm in a vertical plane by its textbook equations: the arm of the starter project, without our dynamics.

M(q) q'' + c(q, q') + g(q) of two rods and a load (Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, 7.3), plus
rotors and friction. The motion is given, and the torques follow from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_model import Arm, read_model
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run

LENGTH, CENTRE, MASS, ABOUT = (0.4, 0.3), (0.2, 0.15), (5.0, 2.0), (0.07, 0.016)
ROTOR, VISCOUS, COULOMB = np.array([0.5, 0.3]), np.array([10.0, 10.0]), np.array([5.0, 3.0])
DRIVE, GRAVITY, WIDTH = 10.0, 9.80665, 0.01
RATE, COUNTS = 250.0, 4_000_000
WAVES, HUMP = np.array([11.0, 13.0]), 0.15


@dataclass(frozen=True)
class Day:
    """What is different in one recording: a load of kg at x, y m in the last frame; factors and more of the others.

    positive: N m of Coulomb friction more in that direction. ripple: share of all friction that waves with the angles
    of the joints, ``WAVES`` times per turn. hump: N m of friction more at rest, of which 1/e is left at ``HUMP`` rad/s.
    width: rad/s, of the speeds in which friction turns round. slow: share of its motion that joint 1 does. held: N m of
    all friction of joint 1, which does not follow its speed; None: it does.
    """

    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gain: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    coulomb: tuple[float, float] = (0.0, 0.0)
    viscous: tuple[float, float] = (0.0, 0.0)
    positive: tuple[float, float] = (0.0, 0.0)
    ripple: float = 0.0
    hump: tuple[float, float] = (0.0, 0.0)
    width: float = WIDTH
    slow: float = 1.0
    held: float | None = None


def model(root: Path) -> Arm:
    """The model of the starter project, with the width of this arm's friction at reversal, and without its servos."""
    arm = read_model(root / "config/starters/csv/model.toml")
    return replace(arm, controller=None, joints=tuple(replace(joint, sign_velocity=WIDTH) for joint in arm.joints))


def motion(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t (m,) s and q, v, a (m, 2) rad and per second: sums of sines that begin at rest."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1 / RATE)
    q = np.tile([0.2, 0.5], (len(t), 1))
    begun = np.clip((t - 0.6) / 2.0, 0.0, 1.0)
    begun = begun**3 * (10 - 15 * begun + 6 * begun**2)
    for j in range(2):
        for f, size in zip((0.15, 0.37, 0.61), (0.5, 0.25, 0.12)):
            q[:, j] += begun * size * np.sin(2 * np.pi * f * rng.uniform(0.9, 1.1) * t + rng.uniform(0, 6))
    v = np.gradient(q, t, axis=0)
    return t, q, v, np.gradient(v, t, axis=0)


def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray, day: Day) -> np.ndarray:
    """(m, 2) N m at the joints."""
    total = np.zeros_like(q)
    kilograms, x, y = day.load
    bodies = (
        (0, MASS[0], (CENTRE[0], 0.0), ABOUT[0]),
        (1, MASS[1], (CENTRE[1], 0.0), ABOUT[1]),
        (1, kilograms, (LENGTH[1] + x, y), 0.0),
    )
    for link, mass, (along, across), about in bodies:
        angle, turn, rate = (np.cumsum(each, axis=1) for each in (q, a, v))
        # places (m, 2) of the joints and of the body, and their accelerations less gravity
        joints = [np.zeros((len(q), 2)), LENGTH[0] * _direction(angle[:, 0])]
        own = _rotated(angle[:, link], along, across)
        felt = _acceleration(turn[:, link], rate[:, link], own) + [0.0, GRAVITY]
        if link == 1:
            felt = felt + _acceleration(turn[:, 0], rate[:, 0], joints[1])
        for joint in range(link + 1):
            arm = own + joints[link] - joints[joint]
            total[:, joint] += mass * (arm[:, 0] * felt[:, 1] - arm[:, 1] * felt[:, 0]) + about * turn[:, link]
    sign = v / np.hypot(v, day.width)
    friction = (VISCOUS + day.viscous) * v + (COULOMB + day.coulomb + day.hump * np.exp(-((v / HUMP) ** 2))) * sign
    friction += day.positive * np.maximum(sign, 0.0)
    if day.held is not None:
        friction[:, 0] = day.held
    return total + ROTOR * a + friction * (1.0 + day.ripple * np.sin(WAVES * q))


def residual_of(arm: Arm, seed: int, day: Day, *, zeros: tuple[float, float] = (0.0, 0.0)) -> Run:
    """The residual of the motion ``seed`` on that day; ``zeros`` rad: joint angles where the encoders read none."""
    t, q, v, a = motion(seed, 12.0)
    noise = 0.005 * np.random.default_rng(seed).normal(size=q.shape)
    return residual_run(f"{seed}", arm, t, q, torque(q + zeros, v, a, day) / DRIVE + noise)


def recorded(path: Path, seed: int, day: Day, *, seconds: float = 12.0) -> Recording:
    """A recording of the motion ``seed`` as it was on that day."""
    t, q, v, a = motion(seed, seconds)
    q[:, 0] = q[0, 0] + day.slow * (q[:, 0] - q[0, 0])
    v[:, 0], a[:, 0] = day.slow * v[:, 0], day.slow * a[:, 0]
    rng, step = np.random.default_rng(seed + 1), 2 * np.pi / COUNTS
    current = torque(q, v, a, day) / DRIVE * day.gain + day.offset + 0.005 * rng.normal(size=q.shape)
    write_table(path, t, {"q": np.round(q / step) * step, "i": current}, Attachments())
    return open_recording(path)


def _direction(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _rotated(angle: np.ndarray, along: float, across: float) -> np.ndarray:
    return along * _direction(angle) + across * _direction(angle + np.pi / 2)


def _acceleration(turn: np.ndarray, rate: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(m, 2) of a point at ``place`` of a body that turns."""
    return turn[:, None] * np.stack([-place[:, 1], place[:, 0]], axis=1) - rate[:, None] ** 2 * place
