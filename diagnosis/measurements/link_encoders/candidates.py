"""Effects that the difference of motor and link encoder may show, with the values that are tried."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from arm_io.types import Array
from arm_model.effects import Effect, Instrument, Parameter, Signals, observed_by, solved, units
from diagnosis.measurements.link_encoders.rows import Rows
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.ripple_orders import TEETH
from identification.ripples import LEAST_CYCLES

DRAGS = (0.0, 0.1, 0.2, 0.3, 0.4)
"""Friction between motor and gear that is tried where the load is not known from masses.

As a share of the largest measured torque.
"""
LOWEST_ORDER, HIGHEST_ORDER = 0.5, 60
"""Orders, cycles per motor turn, between which the strongest are searched."""


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
