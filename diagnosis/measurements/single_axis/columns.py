"""Columns of a single axis with a fine encoder, at the full rate: friction at reversals and near standstill.

The currents of an arm are filtered at 10 to 20 Hz, because encoder quantisation, twice differentiated, exceeds
everything faster, and friction near standstill is not judged. A single axis with a fine scale shows it: its columns are
the laws of the effects at the full rate, through the same filter as its current. Nothing is linearised in velocity or
thinned before it is filtered.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Effect, Instrument, Parameter, Scale, Signals, Values, described, units
from arm_model.system import inverse_dynamics
from arm_model.tables import Temperatures
from diagnosis.residual.expected_current import coulomb_at, transduced, true_angle
from diagnosis.residual.filters import low_pass, motion_of, rate_along, rate_of
from diagnosis.residual.integration import integrated
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.selection.candidate import Candidate
from identification.selection import Index
from identification.selection.cluster_covariance import numbered_on

MOTION_BAND = 100.0
"""Hz: pass-band of the motion behind the expected current."""
COMPARE_BAND = 60.0
"""Hz: pass-band in which measured and expected current are compared."""
ENDS = 0.3
"""s at either end of a recording that filters spoil."""
ROWS_PER_SECOND = 200
"""Rows that are kept: more than three per period of COMPARE_BAND."""
PLACES = 8
"""Parts of the travel."""
SPEEDS = 15
"""Parts of the range of speed; rows in the same part of both are one observation."""
FEWEST_WAVES = 8
"""Waves of one length in the travel: fewer cannot be distinguished from a smooth bend."""


@dataclass(frozen=True)
class AxisSamples:
    """One recording of one axis: t (k,) s uniform, q (k, 1) rad (m), i (k, 1) A.

    temperatures: of its motor, where they were recorded.
    """

    t: Array
    q: Array
    i: Array
    temperatures: Temperatures | None = None


@dataclass(frozen=True)
class Rows:
    """Recordings of one axis one after the other.

    Full rate: parts, per recording Signals of (k,) arrays. Kept rows (m,): residual A; rate of the current A/s; q, v
    rad (m), per s; block from 0; noise A: what the steps of the encoder leave in the residual.
    """

    arm: Arm
    parts: tuple[tuple[Signals, float], ...]
    residual: Array
    rate: Array
    q: Array
    v: Array
    block: Index
    noise: float

    @property
    def cells(self) -> Index:
        """(m,) from 0: rows at the same position and speed.

        A model error is the same at every repetition of a motion, so that all repetitions are one observation.
        """
        place, speed = (
            np.minimum((x - x.min()) / max(float(np.ptp(x)), 1e-12) * parts, parts - 1).astype(np.intp)
            for x, parts in ((self.q, PLACES), (self.v, SPEEDS))
        )
        numbers: Index = np.unique(place * SPEEDS + speed, return_inverse=True)[1]
        return numbers


def rows_of(arm: Arm, recordings: Sequence[AxisSamples], block_seconds: float) -> Rows:
    """The rows of recordings of a one-joint arm, each with its motor as warm as it was."""
    parts, kept, blocks, noises = [], [], [], []
    drive = arm.joints[0]
    constant = described(arm).joints[0].drive_constant
    for one in recordings:
        t, q, i = one.t, one.q, one.i
        warm = replace(arm, temperatures=one.temperatures)
        rate = rate_of(t)
        angle, v, a = motion_of(true_angle(arm, q), _bands(rate)[0], rate)
        torque = inverse_dynamics(warm, angle, v, a, time=t)
        expected = transduced(arm, t, torque / constant)[:, 0]
        sign = v[:, 0] / np.hypot(v[:, 0], drive.sign_velocity)
        current = low_pass(i, _bands(rate)[0], rate)[:, 0]
        s = Signals(
            q=angle[:, 0],
            v=v[:, 0],
            a=a[:, 0],
            sign=sign,
            coulomb=coulomb_at(drive, v[:, 0], sign),
            current=current,
            torque=current * constant,
            t=t - t[0],
            motor=drive.ratio * angle[:, 0],
        )
        parts.append((s, rate))
        keep = _kept(rate)
        stamps = (t - t[0])[keep]
        blocks.append(((stamps - stamps[0]) // block_seconds).astype(np.intp))
        residual = low_pass(i[:, 0] - expected, _bands(rate)[1], rate)[keep]
        slope = low_pass(rate_along(s.current, 1.0 / rate), _bands(rate)[1], rate)[keep]
        kept.append((residual, slope, angle[keep, 0], v[keep, 0]))
        noises.append(_noise(arm, q[:, 0], rate))
    residual, slope, q, v = (np.concatenate(column) for column in zip(*kept))
    return Rows(arm, tuple(parts), residual, slope, q, v, numbered_on(blocks), float(np.mean(noises)))


def _bands(rate: float) -> tuple[float, float]:
    return min(MOTION_BAND, 0.2 * rate), min(COMPARE_BAND, 0.12 * rate)


def _kept(rate: float) -> slice:
    return slice(int(ENDS * rate), -int(ENDS * rate), max(1, round(rate / ROWS_PER_SECOND)))


def _noise(arm: Arm, q: Array, rate: float) -> float:
    """A: noise of the residual due to the encoder's steps, differentiated twice."""
    inertia = arm.joints[0].mass + arm.joints[0].ratio ** 2 * arm.joints[0].rotor_inertia
    w = 2 * np.pi * _bands(rate)[1]
    # sqrt(int_0^w x^4 dx / (pi rate))
    acceleration = float(angle_noise(q[:, None])[0]) * w**2 * np.sqrt(w / (5 * np.pi * rate))
    return float(inertia * acceleration / arm.joints[0].drive_constant)


def encoder_noise(rows: Rows) -> float:
    """Noise of the residual due to the encoder's steps, as a share of the friction current."""
    drive = rows.arm.joints[0]
    friction = max(drive.rest_friction) / drive.drive_constant
    return rows.noise / friction if friction > 0.0 else np.inf


def candidates(rows: Rows) -> Iterator[Candidate]:
    """Every candidate but waves, at every combination of the first values of its searched parameters."""
    for effect in CATALOGUE.values():
        if Instrument.SINGLE_AXIS in effect.observed_by and not effect.wave:
            searched = [p for p in effect.parameters if p.search]
            for values in itertools.product(*(_tried(p, rows) for p in searched)):
                yield _candidate(effect, tuple((p.name, value) for p, value in zip(searched, values)))


def _tried(parameter: Parameter, rows: Rows) -> tuple[float, ...]:
    """First values of a parameter; those that scale with the axis at its own speed, travel and friction."""
    match parameter.scale:
        case None:
            return parameter.search
        case Scale.SPEED:
            largest = max(float(np.max(np.abs(s.v))) for s, _ in rows.parts)
            return tuple(share * largest for share in parameter.shares)
        case Scale.YIELD:
            friction = max(rows.arm.joints[0].rest_friction)
            travel = float(np.ptp(rows.q))
            return tuple(friction / (share * travel) for share in parameter.shares) if friction > 0.0 else ()


def waves(residual: Array, rows: Rows, count: int = 3) -> list[Candidate]:
    """Torques with the sine of the position, at the strongest wave numbers of a residual (m,).

    At least FEWEST_WAVES in the travel, and at most as many as the filter passes at the fastest stroke.
    """
    travel, speed = float(np.ptp(rows.q)), max(float(np.max(np.abs(s.v))) for s, _ in rows.parts)
    highest = COMPARE_BAND * travel / max(speed, 1e-12)
    if highest < FEWEST_WAVES or len(residual) == 0:
        return []
    cycles = np.arange(FEWEST_WAVES, highest, 0.2)
    place = (rows.q - rows.q.min()) / travel
    power = np.array([abs(np.sum(residual * np.exp(-2j * np.pi * n * place))) ** 2 for n in cycles])
    peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    turn = 2 * np.pi * cycles[peaks[np.argsort(-power[peaks])][:count]] / travel / rows.arm.joints[0].ratio
    return [
        _candidate(effect, ((p.name, float(n)),))
        for effect in CATALOGUE.values()
        if Instrument.SINGLE_AXIS in effect.observed_by and effect.wave
        for p in effect.parameters
        if p.whole
        for n in turn
    ]


def _candidate(effect: Effect, shape: tuple[tuple[str, float], ...]) -> Candidate:
    return Candidate(effect.name, 1 if effect.per_joint else None, shape)


def columns(candidate: Candidate, rows: Rows) -> Array:
    """(m, c) A: change of the residual for a unit of each coefficient."""
    effect = candidate.definition
    values = {p.name: 0.0 for p in effect.parameters} | dict(candidate.shape)
    made = []
    for s, rate in rows.parts:
        if effect.delay is not None:
            full = [-rate_along(s.current, 1.0 / rate)]
        else:
            full = [_full(effect, unit, s, rate, rows.arm) for unit in units(effect, values)]
        made.append(np.column_stack([low_pass(column, _bands(rate)[1], rate)[_kept(rate)] for column in full]))
    return np.concatenate(made)


def _full(effect: Effect, p: Values, s: Signals, rate: float, arm: Arm) -> Array:
    constant = arm.joints[0].drive_constant
    if effect.change is not None:
        return _changed(effect, p, s, arm)
    if effect.current is not None:
        return np.asarray(effect.current(p, s), float)
    assert effect.torque is not None
    if effect.rate is not None:
        s = replace(s, state=integrated(effect, p, s, 1.0 / rate))
    return np.asarray(effect.torque(p, s), float) / constant


def _changed(effect: Effect, p: Values, s: Signals, arm: Arm) -> Array:
    """First-order change (k,) A of the expected current, by finite difference of the description."""
    assert effect.change is not None
    step = 1e-4
    changed = effect.change(arm, 1, Values({name: step * value for name, value in p.items()}))
    motion = [x[:, None] for x in (s.q, s.v, s.a)]
    before, after = (
        inverse_dynamics(model, *motion)[:, 0] / model.joints[0].drive_constant for model in (arm, changed)
    )
    return np.asarray((after - before) / step, float)
