"""A Puma seen by a tracker, with something hidden in it.

Kinematics, gravity and instruments written out here, sharing no code with the finder.

The arm is read from its model file as a table of numbers. Recordings come to the finder as people's tables do: CSV,
imported with the rig file that says where the target sits.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from arm_io.types import Array
from armscope.cli import run
from daq.recording import Recording, open_recording
from tests.blind.second.rigid_body import torques

TARGET = np.array([0.05, 0.0, 0.10])
NOISE = 6e-5
"""m a coordinate: a tracker good to 0.1 mm in space."""


@dataclass(frozen=True)
class Wrong:
    """What is hidden. dh (6, 5): errors of theta, d, a, alpha and Hayati's beta.

    The rest by joint or of the tracker as named.
    """

    dh: Array = field(default_factory=lambda: np.zeros((6, 5)))
    sag: Array = field(default_factory=lambda: np.zeros(6))
    spring: Array = field(default_factory=lambda: np.zeros(6))  # rad/(N m) between motors and links
    zero: Array = field(default_factory=lambda: np.zeros(6))
    ripple: tuple[int, float, int, float] | None = None  # joint, amplitude, order, phase
    delay: float = 0.0
    stray: float = 0.0  # share
    broken: tuple[float, float] | None = None  # s
    frame: Array = field(default_factory=lambda: np.zeros(6))  # m and rad by which the rig's tracker frame is off
    target: Array = field(default_factory=lambda: np.zeros(3))
    wanders: Callable[[Array], Array] | None = None  # (m, 3) m that the points are off at times (m,) s


class Puma:
    """The numbers of config/models/puma560.toml."""

    def __init__(self, root: Path) -> None:
        self.root = root
        table = tomllib.loads((root / "config/models/puma560.toml").read_text(encoding="utf-8"))
        joints = table["joint"]
        self.rows = np.array([[0.0, j["d"], j["a"], j["alpha"], 0.0] for j in joints])
        self.mass = np.array([j["mass"] for j in joints])
        self.com = np.array([j["com"] for j in joints])
        self.inertia = np.array([j["inertia"] for j in joints])
        self.limits = np.array([j["limits"] for j in joints])
        self.gear = np.abs([j["gear"] for j in joints])
        self.gravity = np.array(table["gravity"])
        lines = np.array([250, 200, 250, 250, 250, 250])
        self.step = 2 * np.pi / (4 * lines * self.gear)

    def frames(self, q: Array, dh: Array) -> list[Array]:
        """Poses (N, 4, 4) of all links: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta), multiplied out."""
        pose, out = np.broadcast_to(np.eye(4), (len(q), 4, 4)), []
        for j, (theta, d, a, alpha, beta) in enumerate(self.rows + dh):
            ct, st, ca, sa = np.cos(theta + q[:, j]), np.sin(theta + q[:, j]), np.cos(alpha), np.sin(alpha)
            link = np.zeros((len(q), 4, 4))
            link[:, 0, :] = np.stack([ct, -st * ca, st * sa, a * ct], axis=1)
            link[:, 1, :] = np.stack([st, ct * ca, -ct * sa, a * st], axis=1)
            link[:, 2, 1:] = sa, ca, d
            link[:, 3, 3] = 1.0
            cb, sb = np.cos(beta), np.sin(beta)
            pose = pose @ link @ np.array([[cb, 0, sb, 0], [0, 1, 0, 0], [-sb, 0, cb, 0], [0, 0, 0, 1]])
            out.append(pose)
        return out

    def height(self, q: Array) -> Array:
        """(N,) J: potential energy."""
        total = np.zeros(len(q))
        for mass, com, pose in zip(self.mass, self.com, self.frames(q, np.zeros((6, 5)))):
            total -= mass * (pose[:, :3, :3] @ com + pose[:, :3, 3]) @ self.gravity
        return total

    def holding(self, q: Array) -> Array:
        """(N, 6) N m: what holds the arm against gravity, the slope of its potential energy."""
        torque, step = np.zeros_like(q), 1e-4
        for j in range(6):
            move = np.zeros(6)
            move[j] = step
            torque[:, j] = (self.height(q + move) - self.height(q - move)) / (2 * step)
        return torque

    def links(self, motors: Array, t: Array, spring: Array) -> Array:
        """(N, 6) rad: where the links of motors at t (N,) s are: what their springs carry there, as fast as motors."""
        dh, bodies, none = self.rows[:, :4], np.column_stack([self.mass, self.com]), np.zeros((6, 10))
        v = np.gradient(motors, t, axis=0, edge_order=2)
        rates, q = [*zip(v, np.gradient(v, t, axis=0, edge_order=2))], motors
        for _ in range(4):
            load = [torques(dh, bodies, self.inertia, none, self.gravity, at, *of) for at, of in zip(q, rates)]
            q = motors - spring * np.array(load)
        return q

    def seen(self, q: Array, wrong: Wrong) -> Array:
        """(N, 3) m in the frame that the rig takes for the base's."""
        # what holds the arm takes twelve times the time of the rest
        bent = q - wrong.sag * self.holding(q) if np.any(wrong.sag) else q
        last = self.frames(bent, wrong.dh)[-1]
        xyz = last[:, :3, :3] @ (TARGET + wrong.target) + last[:, :3, 3]
        x, y, z = wrong.frame[3:]
        turn = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1.0]])
        return xyz @ turn.T + wrong.frame[:3]

    def motion(self, t: Array, generator: np.random.Generator, wrist: float = 1.0) -> Array:
        """(N, 6) rad: sines at their own frequencies through a good part of every joint's range.

        wrist: share of that by which joints 4 to 6 turn.
        """
        middle, half = self.limits.mean(axis=1), np.ptp(self.limits, axis=1) / 2
        frequency = 0.08 + 0.04 * np.arange(6) + 0.02 * generator.random(6)
        phase = 2 * np.pi * generator.random(6)
        share = np.array([0.6, 0.5, 0.5, wrist * 0.5, wrist * 0.6, wrist * 0.4])
        shift = 0.2 * half * generator.uniform(-1, 1, 6)
        return middle + shift + share * half * np.sin(2 * np.pi * np.outer(t, frequency) + phase)


def record(
    puma: Puma,
    folder: Path,
    name: str,
    wrong: Wrong,
    seed: int,
    *,
    seconds: float = 12.0,
    rest: bool = False,
    wrist: float = 1.0,
) -> Recording:
    """One recording of 250 rows/s, of which the tracker gives every second a point; wrist: as of ``Puma.motion``."""
    generator = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.004)

    def link(at: Array) -> Array:
        return puma.motion(0 * at if rest else at, np.random.default_rng(seed), wrist)

    q = link(t)
    seen = link(t - wrong.delay)
    if np.any(wrong.spring):
        seen = puma.links(seen, t, wrong.spring)
    xyz = puma.seen(seen, wrong) + generator.normal(size=(len(t), 3)) * NOISE
    strays = generator.uniform(size=len(t)) < wrong.stray
    xyz[strays] += generator.uniform(-1, 1, (int(strays.sum()), 3)) * 0.03
    if wrong.wanders is not None:
        xyz += wrong.wanders(t)
    if wrong.broken:
        xyz[(t > wrong.broken[0]) & (t < wrong.broken[1])] = np.nan
    xyz[1::2] = np.nan
    read = q + wrong.zero
    if wrong.ripple is not None:
        joint, amplitude, order, phase = wrong.ripple
        read[:, joint - 1] += amplitude * np.sin(order * puma.gear[joint - 1] * q[:, joint - 1] - phase)
    read = (np.floor(read / puma.step + generator.uniform(size=6)) + 0.5) * puma.step
    current = generator.normal(size=q.shape) * 0.01
    columns = np.column_stack([t, read, current, xyz])
    heading = ["t", *(f"q{j}" for j in range(1, 7)), *(f"i{j}" for j in range(1, 7)), "x", "y", "z"]
    table, out = folder / f"{name}.csv", folder / f"{name}.mcap"
    np.savetxt(table, columns, delimiter=",", header=",".join(heading), comments="", fmt="%.9g")
    rig = puma.root / "config/puma560_sim.toml"
    assert run(["import", str(table), "--rig", str(rig), "--out", str(out)]) == 0
    return open_recording(out)


def recordings(puma: Puma, folder: Path, wrong: Wrong, seed: int) -> tuple[list[Recording], list[Recording]]:
    """Two recordings to fit and two held out."""
    every = [record(puma, folder, f"run{k}", wrong, 100 * seed + k) for k in range(4)]
    return every[:2], every[2:]
