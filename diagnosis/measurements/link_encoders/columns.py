"""Motor minus link encoder, row by row, and the columns of each effect.

The difference d = q_motor / gear - q_link needs no dynamics: it contains lost motion, elasticity, gear errors and
differences of the time stamps. Of the arm only the gear ratios are needed; the load comes from its masses where it has
some, else from the measured current.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Effect, Instrument, Parameter, Signals, observed_by, solved, units
from arm_model.system import rigid_torque_along
from arm_model.tracking import lost_motion
from daq.recording import Recording
from diagnosis.residual.filters import Motion, low_pass, rate_along
from diagnosis.residual.load_errors import load_errors
from diagnosis.residual.noise.encoder_step import encoder_step
from diagnosis.residual.signals import direction_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.ripple_orders import TEETH
from identification.ripples import LEAST_CYCLES
from identification.selection import MAD_TO_STD
from identification.selection.cluster_covariance import numbered_on

Index = NDArray[np.intp]

BAND = 30.0
"""Hz: pass-band of motions and loads; links oscillate on soft springs at 5 to 15 Hz."""
MOST_ROWS = 8000
"""Rows of either set: the difference needs no filter, so that rows may be left out."""
ENDS = 0.1
"""s at either end of a recording that filters spoil."""
DRAGS = (0.0, 0.1, 0.2, 0.3, 0.4)
"""Friction between motor and gear that is tried where the load is not known from masses.

As a share of the largest measured torque.
"""
BORNE = 0.05
"""Share of the largest load that surely holds a link at one side of a gap."""
LOWEST_ORDER, HIGHEST_ORDER = 0.5, 60
"""Orders, cycles per motor turn, between which the strongest are searched."""


BY_ROW = ("difference", "q", "v", "load", "load_errors", "t")
"""Fields of ``Rows`` with an entry per row."""


@dataclass(frozen=True)
class Rows:
    """Rows of some recordings one after the other, at the joints (k,) that have both encoders (1-based).

    difference, q, v, load (m, k) rad, rad/s, N m (m, m/s, N); t (m,) s; starts, names: first row and file name of each
    recording;
    noise (k,): std of the difference from row to row and by the steps of the encoders; ratio (k,): abs(gear);
    largest (k,) N m (N): largest load, the same for all rows that are compared;
    load_errors (m, k, r) N m (N): what is not known of the load, by independent errors of the masses.
    """

    joints: Index
    difference: Array
    q: Array
    v: Array
    load: Array
    known_load: bool
    t: Array
    starts: tuple[int, ...]
    names: tuple[str, ...]
    noise: Array
    ratio: Array
    largest: Array
    load_errors: Array

    @property
    def rows(self) -> int:
        """m."""
        return len(self.t)

    @property
    def parts(self) -> list[slice]:
        """The rows of each recording."""
        return [slice(*span) for span in itertools.pairwise([*self.starts, self.rows])]

    @cached_property
    def load_rate(self) -> Array:
        """(m, k) N m/s (N/s): derivative of the load in time."""
        return np.concatenate([np.gradient(self.load[part], self.t[part], axis=0) for part in self.parts])

    @cached_property
    def borne(self) -> NDArray[np.bool_]:
        """(m, k) whether the load holds a link at one side of a gap, also within the resolution of the load in time."""
        borne = np.abs(self.load) >= BORNE * self.largest
        width = 2 * round(1.0 / BAND / float(np.median(np.diff(self.t)))) + 1
        return np.asarray(ndimage.minimum_filter1d(borne.astype(np.int8), width, axis=0) > 0)

    def of(self, name: str) -> Rows:
        """The rows of one recording, all stretches of it."""
        stretches = [part for part, its in zip(self.parts, self.names) if its == name]
        lengths = [part.stop - part.start for part in stretches]
        starts = tuple(np.cumsum([0, *lengths[:-1]]).tolist())
        by_row: dict[str, Any] = {
            field: np.concatenate([getattr(self, field)[part] for part in stretches]) for field in BY_ROW
        }
        return replace(self, **by_row, starts=starts, names=(name,) * len(stretches))

    def blocks(self, seconds: float) -> Index:
        """(m,) number of the block of ``seconds`` that each row is in, from 0; none reaches over two recordings."""
        since = [self.t[part] - self.t[part.start] for part in self.parts]
        return numbered_on([(t // seconds).astype(np.intp) for t in since])


def joints_with_both(recordings: Sequence[Recording], arm: Arm) -> Index:
    """Joints (1-based) that move and whose link encoder has a value in every row of every recording.

    With coupled joints, the encoders of all links from which the motor's angle follows must have one.
    """
    read = [behind(r, arm) for r in recordings]
    if any(one is None for one in read):
        return np.empty(0, np.intp)
    there = np.all([np.isfinite(one).all(axis=0) for one in read if one is not None], axis=0)
    moved = np.any([np.ptp(r.q, axis=0) > 0 for r in recordings], axis=0)
    return np.flatnonzero(there & moved) + 1


def behind(recording: Recording, arm: Arm) -> Array | None:
    """(m, n) rad (m): angles of the motors over their gears, computed from the link encoders; None without any."""
    return None if recording.ql is None else arm.reported_angles(recording.ql)


def rows_of(recordings: Sequence[Recording], arm: Arm, joints: Index) -> Rows:
    """The rows of ``recordings``, thinned to MOST_ROWS; positions must be uniformly sampled and without gaps."""
    parts: list[tuple[Array, ...]] = []
    scatters, steps = [], []
    k = joints - 1
    known_load = bool(np.any(arm.joint_array("mass") > 0))
    stride = max(1, sum(map(len, recordings)) // MOST_ROWS)
    for r in recordings:
        read = behind(r, arm)
        assert read is not None
        rate = 1.0 / r.dt
        v = rate_along(low_pass(r.q, BAND, rate), r.dt)
        motion = _slow(r.q, r.dt)
        if known_load:
            motion = _slow(_links(r.q, read, rigid_torque_along(arm, *motion)), r.dt)
            load = rigid_torque_along(arm, *motion)
        else:
            load = low_pass(r.i, BAND, rate) * arm.joint_array("drive_constant")
        # the deflection of springs that the model has is expected
        own = lost_motion(arm, motion[0], load) if known_load else np.zeros_like(read)
        difference = (r.q - read - own)[:, k]
        scatters.append(MAD_TO_STD * np.median(np.abs(np.diff(difference, 2, axis=0)), axis=0) / np.sqrt(6))
        steps.append([[encoder_step(angles[:, j]) for angles in (r.q, read)] for j in k])
        keep = slice(int(ENDS * rate), -int(ENDS * rate), stride)
        t = r.t[keep]
        errors = load_errors(arm, *(values[keep] for values in motion))
        parts.append((difference[keep], r.q[keep][:, k], v[keep][:, k], load[keep][:, k], t, errors[:, k]))
    starts = np.cumsum([0, *(len(part[0]) for part in parts[:-1])])
    difference, q, v, load, t, errors = (np.concatenate(columns) for columns in zip(*parts))
    return Rows(
        joints,
        difference,
        q,
        v,
        load,
        known_load,
        t,
        tuple(starts.tolist()),
        tuple(r.path.name for r in recordings),
        # a joint at rest shows no step of its encoders, so the step is taken from where it moves
        np.sqrt(np.mean(np.square(scatters), axis=0) + np.sum(np.max(steps, axis=0) ** 2, axis=1) / 12) + 1e-12,
        np.array([arm.joints[j].ratio for j in k]),
        np.maximum(np.max(np.abs(load), axis=0), 1e-12),
        errors,
    )


def _slow(q: Array, dt: float) -> Motion:
    """Angle, speed and acceleration (m, n) of angles (m, n), ``dt`` s apart, as far as they lie in BAND."""
    angle = low_pass(q, BAND, 1.0 / dt)
    speed = rate_along(angle, dt)
    return angle, speed, rate_along(speed, dt)


def _links(q: Array, read: Array, load: Array) -> Array:
    """(m, n) rad (m): angles of the links: they move as their encoders, and on average bear their load (m, n) N m (N).

    A link oscillates on its spring and moves freely in a gap, so its load is not that of the motor's motion. The zeros
    of the encoders may differ: of the mean difference, the part in proportion to the load is a deflection.
    """
    ahead = np.where(np.isfinite(read).all(axis=0), q - read, 0.0)
    varying = load - load.mean(axis=0)
    yielding = np.sum(varying * ahead, axis=0) / np.maximum(np.sum(varying**2, axis=0), 1e-300)
    return np.asarray(q - (ahead - ahead.mean(axis=0)) - yielding * load.mean(axis=0), float)


@dataclass(frozen=True)
class LinkCandidate(Candidate):
    """A candidate of the link encoders. ``shape``: what its columns are evaluated at.

    "drag" and "lag": friction between motor and gear and s of damping, of a spring; "half_gap" or "by_load": of a gap,
    as the link is held by friction or by its load; "order" or "turn_order": of a wave over the turn of the motor or of
    the joint; none: of a delay and of couplings.
    """

    @property
    def variant(self) -> tuple[str, float]:
        """Name and value of its shape."""
        return self.shape[0] if self.shape else ("", 0.0)

    @property
    def lag(self) -> float:
        """s by which the twist of a spring lags its load: damping over stiffness."""
        return dict(self.shape).get("lag", 0.0)

    @property
    def width(self) -> int:
        """Coefficients: a wave has a sine and a cosine, a coupling every ratio."""
        return len(self.turns) or (2 if self.definition.wave else 1)

    @cached_property
    def turns(self) -> tuple[tuple[int, int], ...]:
        """Of a coupling, by coefficient: the axis that turns, and the motor that turns it (from 1)."""
        linear = self.definition.linear if self.definition.coupling else ()
        return tuple((int(p.name[1]), int(p.name[2])) for p in linear)  # cij

    def parameters(self, coefficients: Sequence[float]) -> dict[str, float]:
        """As of every candidate; the coefficient of a spring is its compliance."""
        effect = self.definition
        if effect.gap is not None:
            return {effect.gap.name: coefficients[0]}
        if effect.spring is not None:
            return {p.name: 1.0 / coefficients[0] for p in effect.parameters if p.inverse}
        return solved(effect, self._order(), coefficients)

    def waves(self, angle: Array) -> Array:
        """(m, 2) rad: the difference by a unit of each coefficient of a wave over an angle (m,) rad, by its own law."""
        effect, signals = self.definition, Signals(motor=angle)
        law = effect.deflection or effect.angle
        assert law is not None
        # the difference is motor minus link, so an excess of the link encoder reduces it
        sign = 1.0 if effect.deflection is not None else -1.0
        return np.column_stack([sign * law(unit, signals) for unit in units(effect, self._order())])

    def _order(self) -> dict[str, float]:
        return {p.name: self.variant[1] for p in self.definition.parameters if p.whole}


def candidates(rows: Rows) -> Iterator[LinkCandidate]:
    """Every candidate with each value of its nonlinear parameter."""
    yield late()
    yield from couplings(rows)
    for column, joint in enumerate(int(j) for j in rows.joints):
        for effect in observed_by(Instrument.LINK_ENCODER):
            yield from _at_joint(effect, rows, column, joint)


def _at_joint(effect: Effect, rows: Rows, column: int, joint: int) -> Iterator[LinkCandidate]:
    """Candidates of one effect at one joint.

    None for an effect that changes the description: it adds a constant, and a constant is always fitted.
    """
    load = rows.load[:, column]
    if effect.gap is not None:
        yield from (LinkCandidate(effect.name, joint, (("half_gap", gap),)) for gap in _gaps(effect.gap))
        borne = load[rows.borne[:, column]]
        if np.any(borne > 0) and np.any(borne < 0):
            yield LinkCandidate(effect.name, joint, (("by_load", 1.0),))
    elif effect.spring is not None:
        yield from (
            LinkCandidate(effect.name, joint, (("drag", drag), ("lag", 0.0)))
            for drag in (DRAGS[:1] if rows.known_load else DRAGS)
        )
    elif effect.wave and effect.deflection is not None:
        for n in (*orders(effect), *_of_last_wheel(rows, column)):
            yield LinkCandidate(effect.name, joint, (("order", n),))
    elif effect.wave and np.ptp(rows.q[:, column]) > np.pi:
        # ripple of the link encoder, over the joint's angle; within half a turn a slow wave could be any smooth curve
        yield from (LinkCandidate(effect.name, joint, (("turn_order", n),)) for n in orders(effect))


def _of_last_wheel(rows: Rows, k: int) -> list[float]:
    """Cycles per motor turn, below LOWEST_ORDER, of the teeth of the last wheel, with LEAST_CYCLES over the travel."""
    ratio, lowest = float(rows.ratio[k]), LEAST_CYCLES / max(turns(rows, k), 1e-9)
    return [n / ratio for n in range(TEETH[0], TEETH[1] + 1) if lowest <= n / ratio < LOWEST_ORDER]


def standing_waves(residual: Array, rows: Rows, k: int) -> list[LinkCandidate]:
    """Waves of the gear at the k-th joint at the strongest orders, whole or not, of a residual (m,)."""
    gears = (e for e in observed_by(Instrument.LINK_ENCODER) if e.wave and e.deflection is not None)
    joint = int(rows.joints[k])
    return [
        LinkCandidate(effect.name, joint, (("order", order),))
        for effect in gears
        for order in standing_orders(residual, rows, k)
    ]


def late() -> LinkCandidate:
    """The candidate of late link encoders, with the same delay at all joints."""
    return next(
        LinkCandidate(effect.name, None) for effect in observed_by(Instrument.LINK_ENCODER) if effect.delay is not None
    )


def couplings(rows: Rows) -> list[LinkCandidate]:
    """Candidates of axes that other motors turn too, if all of them have both encoders."""
    effects = (effect for effect in observed_by(Instrument.LINK_ENCODER) if effect.coupling)
    of_effects = (LinkCandidate(effect.name, None) for effect in effects)
    return [one for one in of_effects if {joint for pair in one.turns for joint in pair} <= set(rows.joints.tolist())]


def _gaps(gap: Parameter) -> tuple[float, ...]:
    """First half gaps (rad or m) that are tried: an encoder at the link resolves half of what currents show."""
    return (0.5 * gap.search[0], *gap.search)


def orders(effect: Effect) -> tuple[float, ...]:
    """Orders of a ripple that are tried."""
    return next((p.search for p in effect.parameters if p.whole), ())


def columns(candidate: LinkCandidate, rows: Rows, k: int) -> Array:
    """(m, c) rad: what a unit of each of c coefficients adds to the encoder difference at the k-th joint of ``rows``.

    c = 0 where the candidate does not act.
    """
    if candidate.turns:  # q_link = (1 + C) q
        return _turned(candidate, rows, int(rows.joints[k]))
    if candidate.joint is None:  # q(t) - q(t - delay)
        return rows.v[:, k, None]
    if rows.joints[k] != candidate.joint:
        return np.empty((rows.rows, 0))
    q, load, largest = rows.q[:, k], rows.load[:, k], float(rows.largest[k])
    match candidate.variant:
        case "drag", drag:
            late = candidate.lag * rows.load_rate[:, k]
            return (load - late - drag * largest * direction_of(rows.v[:, k]))[:, None]
        case "by_load", _:
            return np.sign(load)[:, None]
        case "half_gap", half_gap:
            return _play(q, half_gap, rows.starts)[:, None] / half_gap
        case "order", _:
            return candidate.waves(rows.ratio[k] * q)
    return candidate.waves(q)


def _turned(coupling: LinkCandidate, rows: Rows, joint: int) -> Array:
    """``columns`` of a coupling at a joint (from 1)."""
    places = [place for place, (axis, _) in enumerate(coupling.turns) if axis == joint]
    columns = np.zeros((rows.rows, coupling.width if places else 0))
    for place in places:
        columns[:, place] = -rows.q[:, rows.joints == coupling.turns[place][1]][:, 0]
    return columns


def turns(rows: Rows, k: int) -> float:
    """Motor turns that the k-th joint covers."""
    return float(np.ptp(rows.q[:, k]) * rows.ratio[k] / (2 * np.pi))


def standing_orders(residual: Array, rows: Rows, k: int, count: int = 3) -> list[float]:
    """Strongest cycles per motor turn, whole or not (a wave of the gear wheel is not), of a residual (m,).

    Peaks of the spectrum over motor angle of its averages in bins of a 128th turn, less their running mean over a turn.
    """
    if turns(rows, k) < 2.0:
        return []
    angle = rows.q[:, k] * rows.ratio[k] / (2 * np.pi)
    bins = ((angle - angle.min()) * 128).astype(np.intp)
    number = np.bincount(bins)
    mean = np.bincount(bins, weights=residual) / np.maximum(number, 1)
    wave = np.where(number > 0, mean - ndimage.uniform_filter1d(mean, 128), 0.0)
    length = 8 * len(wave)
    power = np.abs(np.fft.rfft(wave, length)) ** 2
    order = np.fft.rfftfreq(length, 1 / 128)
    power[(order < LOWEST_ORDER) | (order > HIGHEST_ORDER)] = 0.0
    peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    return [float(order[peak]) for peak in peaks[np.argsort(-power[peaks])][:count]]


def _play(q: Array, half_gap: float, starts: tuple[int, ...]) -> Array:
    """Motor minus link where friction holds the link: it moves only while the motor is at either side of the gap."""
    out = np.empty_like(q)
    begun = set(starts)
    d, before = 0.0, q[0]
    for row, angle in enumerate(q.tolist()):
        d = 0.0 if row in begun else min(max(d + angle - before, -half_gap), half_gap)
        out[row], before = d, angle
    return out
