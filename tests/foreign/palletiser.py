"""A palletiser in its vertical plane, by virtual work over the absolute angles of its links; nothing of armscope's.

Its motors turn three links against the base, not against one another (parallelograms): the controller shows absolute
angles m, the joints of a model have q1 = m1, q2 = m2 - m1, q3 = m3 - m2. The torque of motor k is

    tau_k = sum_i m_i dp_i/dm_k . (p_i'' - g) + I_k m_k'' + F_k sign m_k' + B_k m_k',    p_i the centre of link i.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_model import Arm, Coupling, Joint
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table

RATE = 250.0
NOISE = 0.02
"""A."""
GRAVITY = 9.81
GEAR, CONSTANT = 100.0, 0.1
COUPLING = (Coupling(2, 1, -1.0), Coupling(3, 2, -1.0))
RIG = """
name = "palletiser"
[trigger]
rate = 250.0
[tracker]
target = [0.05, 0.02, 0.1]
"""


@dataclass(frozen=True)
class Palletiser:
    """Three links.

    length, centre (3,) m along each link; mass (3,) kg; inertia (3,) kg m2 about each centre; coulomb, viscous (3,)
    N m and N m s/rad at the joints; zero (3,) rad: what the encoders read too much.
    """

    length: np.ndarray
    centre: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    zero: np.ndarray

    def reach(self) -> np.ndarray:
        """(i, k) m: how far motor k alone carries the centre of link i."""
        return np.tril(np.tile(self.length, (3, 1)), -1) + np.diag(self.centre)

    def torque(self, m: np.ndarray, rate: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(n, 3) N m of the motors at absolute angles m and their rates, (n, 3)."""
        a = self.reach()
        along = np.stack([np.cos(m), np.sin(m)], axis=-1)
        across = np.stack([-np.sin(m), np.cos(m)], axis=-1)
        swing = across * second[..., None] - along * (rate**2)[..., None]
        acceleration = np.einsum("ik,nkd->nid", a, swing) + np.array([0.0, GRAVITY])
        lifted = np.einsum("i,ik,nkd,nid->nk", self.mass, a, across, acceleration)
        friction = self.coulomb * rate / np.hypot(rate, 0.01) + self.viscous * rate
        return lifted + self.inertia * second + friction

    def target(self, m: np.ndarray, along: float, across: float) -> np.ndarray:
        """(n, 3) m: a point of the last link, ``along`` it from its end and ``across``, in the plane."""
        at = np.stack([np.cos(m) @ self.length, np.sin(m) @ self.length, np.zeros(len(m))], axis=-1)
        end = m[:, 2]
        turned = [along * np.cos(end) - across * np.sin(end), along * np.sin(end) + across * np.cos(end)]
        return at + np.column_stack([*turned, np.zeros(len(m))])


HEALTHY = Palletiser(
    length=np.array([0.9, 0.8, 0.3]),
    centre=np.array([0.4, 0.35, 0.1]),
    mass=np.array([30.0, 18.0, 6.0]),
    inertia=np.array([2.5, 1.2, 0.05]),
    coulomb=np.array([12.0, 10.0, 4.0]),
    viscous=np.array([8.0, 6.0, 2.0]),
    zero=np.zeros(3),
)


def model() -> Arm:
    """The same arm as a model file has it; the frame of a link sits at its far end."""
    joints = [
        Joint(
            a=length,
            mass=mass,
            com=(centre - length, 0.0, 0.0),
            inertia=(0.0, inertia, inertia, 0.0, 0.0, 0.0),
            gear=GEAR,
            torque_constant=CONSTANT,
            coulomb=(coulomb / GEAR,) * 2,
            viscous=(viscous / GEAR**2,) * 2,
            limits=(-3.2, 3.2),
        )
        for length, centre, mass, inertia, coulomb, viscous, _ in zip(*vars(HEALTHY).values())
    ]
    return Arm(name="palletiser", joints=tuple(joints), gravity=(0.0, -GRAVITY, 0.0), coupling=COUPLING)


def motion(seed: int, seconds: float = 9.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t (n,) and absolute angles with two rates (n, 3): Fourier series that fade in from and out to a standstill."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1 / RATE)
    w = 2 * np.pi * 0.2 * np.arange(1, 6)
    a, b = 0.25 * rng.normal(size=(2, 5, 3)) / np.sqrt(np.arange(1, 6))[:, None]
    phase = np.clip(np.minimum(t - 0.5, seconds - 0.5 - t), 0.0, 1.0)
    fade = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
    q = np.array([1.3, 0.2, 0.0]) + fade[:, None] * (np.sin(np.outer(t, w)) @ a + np.cos(np.outer(t, w)) @ b)
    rate = np.gradient(q, 1 / RATE, axis=0)
    return t, q, rate, np.gradient(rate, 1 / RATE, axis=0)


def recorded(arm: Palletiser, path: Path, seed: int, *, tracker: bool = False, links: bool = False) -> Recording:
    """A run of the arm as its controller would log it: absolute angles, currents; tracker, link encoders if asked."""
    rng = np.random.default_rng(100 + seed)
    t, q, rate, second = motion(seed)
    i = arm.torque(q, rate, second) / (GEAR * CONSTANT)
    signals = {"q": q + arm.zero + 2e-6 * rng.normal(size=q.shape), "i": i + NOISE * rng.normal(size=i.shape)}
    if tracker:
        signals["xyz"] = arm.target(q, 0.05, 0.02) + np.array([0.0, 0.0, 0.1]) + 5e-5 * rng.normal(size=q.shape)
    if links:
        signals["ql"] = np.diff(q, axis=1, prepend=0.0) + 2e-6 * rng.normal(size=q.shape)
    write_table(path, t, signals, Attachments(rig=RIG))
    return open_recording(path)
