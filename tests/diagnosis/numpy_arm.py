"""A two-link arm in a few lines of numpy, with friction and torques that a test chooses; nothing of it is ours.

Both axes are horizontal and parallel. The motion is given, and the motors give what it needs (the textbook's equations
of two links, Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, 2020, section 6.4). Encoders have steps and
the currents noise; rows are recorded at 500 Hz.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from arm_model import Arm, Joint
from arm_model.tables.drive import FrictionCurve
from armscope.cli import run
from daq.recording import Recording, open_recording

RATE, COUNTS, NOISE = 500.0, 2**20, 0.01
GEAR, CONSTANT, ROTOR = np.array([100.0, 80.0]), np.array([0.11, 0.09]), np.array([1.2, 0.5])
MASS, CENTRE, INERTIA, LENGTH, GRAVITY = (7.0, 4.0), (0.22, 0.15), (0.3, 0.08), 0.45, 9.81
REST = 0.004
"""rad/s: width over which friction changes its sign."""
CENTRE_OF_MOTION = (-0.6, 0.5)
"""rad."""

Friction = Callable[[np.ndarray], np.ndarray]
"""(k,) N m against the motion at speeds (k,) >= 0 rad/s."""


def straight(level: float, slope: float) -> Friction:
    """Coulomb and viscous friction."""
    return lambda v: level + slope * v


def humped(v: np.ndarray) -> np.ndarray:
    """N m: a constant, a Stribeck hump and |v|^0.6."""
    return 5.0 + 1.5 * np.exp(-((v / 0.05) ** 2)) + 6.0 * v**0.6


@dataclass(frozen=True)
class NumpyArm:
    """friction: of each joint, moving positive and moving negative.

    torque: (m, 2) N m that the drives must provide in addition, of q, v, t and the load (m, 2); error: (m, 2) rad that
    the encoders read in excess, of the motor angles. temperature: (m, 2) degC of the motors over t, which is recorded.
    """

    friction: tuple[tuple[Friction, Friction], tuple[Friction, Friction]]
    torque: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None
    error: Callable[[np.ndarray], np.ndarray] | None = None
    current: Callable[[np.ndarray], np.ndarray] = field(default=lambda i: i)
    temperature: Callable[[np.ndarray], np.ndarray] | None = None

    def record(
        self, path: Path, seed: int, seconds: float = 20.0, centre: Sequence[float] = CENTRE_OF_MOTION
    ) -> Recording:
        """A recording of the motion ``seed`` about a centre (2,) rad, through a table and ``armscope import``."""
        rng = np.random.default_rng(seed)
        t = np.arange(int(seconds * RATE)) / RATE
        q, v, a = _motion(rng, t)
        q = q + centre
        load = _links(q, v, a)
        rub = np.column_stack([_rubbing(both, v[:, j]) for j, both in enumerate(self.friction)])
        torque = load + ROTOR * a + rub
        if self.torque is not None:
            torque = torque + self.torque(q, v, t, load)
        read = q if self.error is None else q + self.error(q * GEAR)
        step = 2 * np.pi / COUNTS
        current = self.current(torque / (GEAR * CONSTANT)) + NOISE * rng.normal(size=q.shape)
        table, names = np.column_stack([t, np.round(read / step) * step, current]), "t,q1,q2,i1,i2"
        if self.temperature is not None:
            table, names = np.column_stack([table, np.round(self.temperature(t), 1)]), f"{names},temp1,temp2"
        log = path.with_suffix(".csv")
        np.savetxt(log, table, delimiter=",", header=names, comments="", fmt="%.9g")
        assert run(["import", str(log), "--out", str(path)]) == 0
        return open_recording(path)


def _motion(rng: np.random.Generator, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m, 2) rad, rad/s, rad/s2: slow and fast sines of both joints after a second of rest, smoothly begun."""
    x = np.clip((t - 1.0) / 2.0, 0.0, 1.0)
    inside = (t > 1.0) & (t < 3.0)
    b = x**3 * (10 - 15 * x + 6 * x**2)
    b1 = inside * 30 * x**2 * (1 - x) ** 2 / 2.0
    b2 = inside * 60 * x * (1 - x) * (1 - 2 * x) / 4.0
    sums = []
    for size in (0.9, 1.2):
        w = 2 * np.pi * np.array([0.06, 0.13, 0.29, 0.53]) * rng.uniform(0.85, 1.15, 4)
        amplitude = size * np.array([0.45, 0.35, 0.2, 0.1]) * rng.uniform(0.8, 1.2, 4)
        phase = np.outer(t, w) + rng.uniform(0, 2 * np.pi, 4)
        s, s1, s2 = np.sin(phase) @ amplitude, np.cos(phase) @ (amplitude * w), -np.sin(phase) @ (amplitude * w**2)
        sums.append((b * s, b1 * s + b * s1, b2 * s + 2 * b1 * s1 + b * s2))
    q, v, a = (np.column_stack(parts) for parts in zip(*sums))
    return q, v, a


def _links(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(m, 2) N m that the links take."""
    (m1, m2), (c1, c2), (i1, i2), g = MASS, CENTRE, INERTIA, GRAVITY
    cos2, h = np.cos(q[:, 1]), -m2 * LENGTH * c2 * np.sin(q[:, 1])
    d11 = m1 * c1**2 + i1 + m2 * (LENGTH**2 + c2**2 + 2 * LENGTH * c2 * cos2) + i2
    d12, d22 = m2 * (c2**2 + LENGTH * c2 * cos2) + i2, m2 * c2**2 + i2
    g2 = m2 * c2 * g * np.cos(q.sum(axis=1))
    g1 = (m1 * c1 + m2 * LENGTH) * g * np.cos(q[:, 0]) + g2
    one = d11 * a[:, 0] + d12 * a[:, 1] + h * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2) + g1
    return np.column_stack([one, d12 * a[:, 0] + d22 * a[:, 1] - h * v[:, 0] ** 2 + g2])


def _rubbing(both: tuple[Friction, Friction], v: np.ndarray) -> np.ndarray:
    size = np.where(v > 0, both[0](np.abs(v)), both[1](np.abs(v)))
    return np.asarray(size * np.tanh(v / REST))


def model(coulomb: Sequence[tuple[float, float]], viscous: Sequence[float], curve: Friction | None = None) -> Arm:
    """The healthy arm, with Coulomb (positive, negative) N m and viscous N m s/rad friction at the joints.

    curve: all friction of joint 2 instead, at 40 speeds.
    """
    joints = []
    for j in range(2):
        level, slope, bent = coulomb[j], viscous[j], None
        if curve is not None and j == 1:
            speed = np.geomspace(0.004, 1.6, 40)
            slope, least = np.polyfit(speed, curve(speed), 1)
            level = least, least
            rest = tuple(float(x) for x in curve(speed) - least - slope * speed)
            bent = FrictionCurve(speed=tuple(speed.tolist()), positive=rest, negative=rest)
        joints.append(
            Joint(
                convention="placed",
                axis=(0.0, 0.0, 1.0),
                xyz=(LENGTH * j, 0.0, 0.0),
                rpy=(0.0, 0.0, 0.0),
                mass=MASS[j],
                com=(CENTRE[j], 0.0, 0.0),
                inertia=(0.6 * INERTIA[j], 0.6 * INERTIA[j], INERTIA[j], 0.0, 0.0, 0.0),
                gear=float(GEAR[j]),
                torque_constant=float(CONSTANT[j]),
                rotor_inertia=float(ROTOR[j] / GEAR[j] ** 2),
                coulomb=(level[0] / GEAR[j], level[1] / GEAR[j]),
                viscous=(float(slope) / GEAR[j] ** 2, float(slope) / GEAR[j] ** 2),
                friction_curve=bent,
                sign_velocity=REST,
            )
        )
    return Arm("numpy arm", tuple(joints), gravity=(0.0, -GRAVITY, 0.0))
