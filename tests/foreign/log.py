"""The log of a foreign controller, as a CSV file: sampled, filtered, jittered, quantised, with defects of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter

from tests.foreign.arms import ForeignArm
from tests.foreign.plant import STEP, Array, Run

START = 0.05
"""s of a run that its log leaves out at either end: what happens later is so much earlier in the file."""


@dataclass(frozen=True)
class Logger:
    """How a controller logs.

    rate       Hz; jitter: standard deviation of a row's instant, as a share of the period (the stamps are right)
    currents   motor currents instead of torques at the joint
    filter     mean: torques averaged over a row; both: angles and torques through one low-pass; none
    demands    whether the log has them
    noise      of the torques, as a share of the rated one; colour: share of it that is correlated over ``memory`` s
    digits     of a torque, as a share of the rated one
    period     s between setpoints; bandwidth of the servos, rad/s
    """

    rate: float
    jitter: float
    currents: bool
    filter: str
    demands: bool
    noise: float
    colour: float
    memory: float
    digits: float
    period: float
    bandwidth: float

    def deviation(self, arm: ForeignArm) -> Array:
        """(n,) of what a log adds to a torque."""
        rated = np.array([joint.rated for joint in arm.joints])
        return rated * float(np.hypot(self.noise, self.digits / np.sqrt(12.0)))


@dataclass(frozen=True)
class Defects:
    """What is wrong with a log, per drive (n,) or for all; 0: nothing.

    gain, offset   of the torques, in shares and N m; hum: N m at ``hertz``
    late           s by which torques are late; lost: rows of torque that are missing from row ``lost_at`` on
    waves, cycles  error of an angle, rad, and its periods per turn of the drive; jump: rad, at ``jump_at`` s
    """

    gain: Array
    offset: Array
    hum: Array
    waves: Array
    cycles: Array
    jump: Array
    phase: float = 0.0
    hertz: float = 50.0
    late: float = 0.0
    lost: int = 0
    lost_at: float = 0.0
    jump_at: float = 0.0

    @classmethod
    def none(cls, count: int) -> Defects:
        """Of an arm with this many drives."""
        zero = np.zeros(count)
        return cls(gain=zero, offset=zero, hum=zero, waves=zero, cycles=np.ones(count), jump=zero)

    def with_one(self, name: str, drive: int, value: float) -> Defects:
        """One value of one drive (from 1)."""
        values = getattr(self, name).copy()
        values[drive - 1] = value
        return replace(self, **{name: values})


def logged(run: Run, target: Array, logger: Logger, defects: Defects, seed: int, arm: ForeignArm) -> dict[str, Array]:
    """Columns t, q, tau and qref of what is logged, (m,) or (m, n); torques in N m at the joint."""
    rng = np.random.default_rng(seed)
    t = np.arange(START, run.t[-1] - START, 1.0 / logger.rate)
    t = np.round(t + np.clip(rng.normal(size=t.shape), -2.0, 2.0) * logger.jitter / logger.rate, 6)
    angle, torque = run.angle, run.torque
    if logger.filter == "both":
        b, a = butter(2, min(0.35 * logger.rate, 100.0), fs=1.0 / STEP)
        angle, torque = (lfilter(b, a, one - one[0], axis=0) + one[0] for one in (angle, torque))
    seen = _mean(t - defects.late, 1.0 / logger.rate, run.t, torque) if logger.filter == "mean" else None
    seen = _at(t - defects.late, run.t, torque) if seen is None else seen
    q = np.column_stack([CubicSpline(run.t, column)(t) for column in angle.T])
    if defects.lost:
        row = int(np.searchsorted(t, defects.lost_at))
        seen = seen[np.minimum(np.arange(len(t)) + np.where(np.arange(len(t)) >= row, defects.lost, 0), len(t) - 1)]
    seen = seen * (1.0 + defects.gain) + defects.offset
    seen = seen + defects.hum * np.sin(2 * np.pi * defects.hertz * t + defects.phase)[:, None]
    q = q + defects.waves * np.sin(defects.cycles * q + defects.phase) + defects.jump * (t >= defects.jump_at)[:, None]
    return {"t": t, "q": _stepped(q, arm), "tau": _noisy(seen, logger, rng, arm), "qref": _at(t, run.t, target)}


def _mean(t: Array, width: float, times: Array, torque: Array) -> Array:
    """Over a row's width about its instant, of torques that hold from half a step before to half a step after."""
    edges = np.append(times, times[-1] + STEP) - STEP / 2
    summed = np.vstack([np.zeros(torque.shape[1]), np.cumsum(torque, axis=0) * STEP])
    return (_at(t + width / 2, edges, summed) - _at(t - width / 2, edges, summed)) / width


def _at(t: Array, times: Array, values: Array) -> Array:
    return np.column_stack([np.interp(t, times, column) for column in values.T])


def _stepped(q: Array, arm: ForeignArm) -> Array:
    step = np.array([joint.step for joint in arm.joints])
    return np.floor(q / step) * step


def _noisy(torque: Array, logger: Logger, rng: np.random.Generator, arm: ForeignArm) -> Array:
    rated = np.array([joint.rated for joint in arm.joints])
    keep = float(np.exp(-1.0 / (logger.memory * logger.rate)))
    white, driven = rng.normal(size=(2, *torque.shape))
    slow = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], driven, axis=0)
    noisy = torque + logger.noise * rated * (np.sqrt(1.0 - logger.colour**2) * white + logger.colour * slow)
    digit = logger.digits * rated
    return np.round(noisy / digit) * digit


def write_csv(path: Path, columns: dict[str, Array], logger: Logger, arm: ForeignArm) -> None:
    """As the documents say that ``import`` takes it; the torques of a log without currents stand in the columns i."""
    per_torque = np.ones(len(arm.joints))
    if logger.currents:
        per_torque = 1.0 / np.array([joint.gear * joint.torque_constant for joint in arm.joints])
    groups = {"q": columns["q"], "i": columns["tau"] * per_torque}
    if logger.demands:
        groups["qref"] = columns["qref"]
    names = [f"{name}{k}" for name in groups for k in range(1, len(arm.joints) + 1)]
    table = np.column_stack([columns["t"] - columns["t"][0], *groups.values()])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(["t", *names]), comments="")
