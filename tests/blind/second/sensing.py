"""From a motion to the rows of a table: encoders, transducers and their noise, converter, link encoders, tracker."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from arm_io.types import Array
from tests.blind.second.laboratory import INTERPOLATED, Laboratory, holding
from tests.blind.second.plant import Plant, readings
from tests.blind.second.rigid_body import target
from tests.blind.second.simulate import Motion

TARGET = (0.05, 0.0, 0.1)
"""m in the frame of the last link."""
POINT_NOISE = 1e-4
"""m rms."""


def _zeros(*shape: int) -> Array:
    return np.zeros(shape)


@dataclass(frozen=True)
class Sensing:
    """What is wrong with what the instruments say; (6,) by joint.

    current_read = (1 + gain) i - cubic i^3 + offset + drift (t / T - 1/2) + hum, i ``delay`` s late and, from row
    ``lost[0]`` on, ``lost[1]`` rows early; hum (6, 3): A, Hz, phase; sag (6,) rad/(N m); wrong: share of
    the tracker's points, m; ring: m and Hz of a tripod.
    """

    gain: Array = field(default_factory=lambda: _zeros(6))
    cubic: Array = field(default_factory=lambda: _zeros(6))
    offset: Array = field(default_factory=lambda: _zeros(6))
    drift: Array = field(default_factory=lambda: _zeros(6))
    hum: Array = field(default_factory=lambda: _zeros(6, 3))
    delay: float = 0.0
    lost: tuple[int, int] = (0, 0)
    sag: Array = field(default_factory=lambda: _zeros(6))
    tracker_delay: float = 0.0
    wrong: tuple[float, float] = (0.0, 0.0)
    ring: tuple[float, float] = (0.0, 0.0)


Rows = dict[str, Array]
"""t (m,) s; q, i, qref, and where there are such instruments ql (m, n) and xyz (m, 3)."""


def rows(where: Laboratory, plant: Plant, sensing: Sensing, motion: Motion, noise: np.random.Generator | None) -> Rows:
    """What is recorded; without noise (None) the instruments are ideal but for what is wrong with them."""
    t = np.arange(0.0, motion.duration, 1.0 / where.rate)
    taken = {"t": t, "qref": motion.demand(t), "q": _angles(plant, motion, t, noise is not None)}
    taken["i"] = _currents(where, sensing, motion, t, noise)
    if where.link_encoders:
        link = _at(motion.t, motion.link, t)
        step = 2 * np.pi / where.link_encoders
        taken["ql"] = link if noise is None else np.round(link / step) * step
    if where.tracker:
        taken["xyz"] = _points(plant, sensing, motion, t, noise)
    return taken


def _at(grid: Array, values: Array, t: Array) -> Array:
    return np.column_stack([np.interp(t, grid, column) for column in values.T])


def _angles(plant: Plant, motion: Motion, t: Array, counted: bool) -> Array:
    """The counters see whole counts, the servos parts of them."""
    count = plant.count * (INTERPOLATED if counted else 1e-3)
    missed = plant.missed.copy()
    missed[:, 0] *= plant.count / count
    its = plant._replace(count=count, missed=missed)
    return readings(its, _at(motion.t, motion.angle, t), t)


def _currents(where: Laboratory, s: Sensing, motion: Motion, t: Array, noise: np.random.Generator | None) -> Array:
    step = motion.t[1] - motion.t[0]
    share = 1.0 - np.exp(-2 * np.pi * where.bandwidth * step)
    slow = lfilter([share], [1.0, share - 1.0], motion.current, axis=0)
    instants = t - s.delay
    if s.lost[1]:
        instants = instants + np.where(np.arange(len(t)) >= s.lost[0], s.lost[1] / where.rate, 0.0)
    true = _at(motion.t, slow, instants)
    read = (1.0 + s.gain) * true - s.cubic * true**3 + s.offset + s.drift * (t / t[-1] - 0.5)[:, None]
    read += s.hum[:, 0] * np.sin(2 * np.pi * np.outer(t, s.hum[:, 1]) + s.hum[:, 2])
    if noise is None:
        return read
    size = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    read += where.white * size * noise.normal(size=read.shape)
    keep = np.exp(-1.0 / (where.rate * where.correlation))
    start = noise.normal(size=(1, 6))
    red = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], noise.normal(size=read.shape), axis=0, zi=keep * start)[0]
    read += where.colour * size * red
    # the drives switch at some kHz that wander: sampled, a line without a place
    wander = np.cumsum(noise.normal(size=read.shape), axis=0) * 0.6
    read += where.ripple * np.sin(2 * np.pi * noise.uniform(size=6) * np.arange(len(t))[:, None] + wander)
    lsb = 40.0 / 2**where.bits
    return np.clip(np.round(read / lsb) * lsb, -20.0, 20.0)


def _points(plant: Plant, s: Sensing, motion: Motion, t: Array, noise: np.random.Generator | None) -> Array:
    link = _at(motion.t, motion.link, t - s.tracker_delay)
    if np.any(s.sag):
        link = link - s.sag * np.array([holding(plant, q) for q in link])
    points = target(plant.dh, link, np.array(TARGET))
    if s.ring[0]:
        # a tripod that the arm's reaction moves: a light oscillator driven by the first joint's acceleration
        w, step = 2 * np.pi * s.ring[1], t[1] - t[0]
        push = np.gradient(np.gradient(link[:, 0], t), t) + 0.3 * np.gradient(np.gradient(link[:, 1], t), t)
        r = np.exp(-0.01 * w * step)
        swing = lfilter([step**2], [1.0, -2 * r * np.cos(w * step), r**2], push)
        swing *= s.ring[0] / max(float(np.std(swing)), 1e-12)
        points += swing[:, None] * np.array([0.8, 0.6, 0.1])
    if noise is None:
        return points
    points += POINT_NOISE * noise.normal(size=points.shape)
    wrong = noise.uniform(size=len(t)) < s.wrong[0]
    away = noise.normal(size=(len(t), 3))
    points[wrong] += s.wrong[1] * (away / np.linalg.norm(away, axis=1, keepdims=True))[wrong]
    return points


def with_joint(values: Array, joint: int, value: object) -> Array:
    """A copy with one joint's row replaced; joint from 1."""
    changed = values.copy()
    changed[joint - 1] = value
    return changed


def changed(sensing: Sensing, **fields: object) -> Sensing:
    """A copy."""
    return replace(sensing, **fields)  # type: ignore[arg-type]
