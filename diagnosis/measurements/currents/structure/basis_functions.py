"""Functions of one variable (or of two angles) that a residual may depend on where no effect explains it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Variable
from diagnosis.measurements.currents.structure.shared_bases import WAVE_STEPS, Bases, bends_of
from diagnosis.residual.filters import COMPARE_BAND, low_pass_gain
from diagnosis.residual.signals import signals_of
from diagnosis.selection.design import Columns, Dataset, Pair
from identification.selection import Split

PLACES = 100
"""Knots over the range of a joint of the function for local effects, such as a damaged tooth."""
CYCLES = (0.5, 40.0)
"""Cycles per motor revolution between which a ripple is searched for."""
BINS_PER_TURN = 256
"""Bins of a motor's turn over which a residual is summed: six for each of the most ``CYCLES``."""
UNMIXED = ("velocity", "acceleration", "current")
"""Variables whose functions are not multiplied by direction or velocity, which they contain."""
TWO_FACED = (Variable.POSITION, Variable.LOAD)
"""Variables that may have a function per direction: a gear loses torque where it drives."""
PLAYS = (0.004, 0.01, 0.02, 0.05, 0.1)
"""Half-widths of play operators, of the range of the current."""


@dataclass(frozen=True)
class Functions:
    """Functions (rows, k) of a variable at a joint of a dataset, times each of several factors (rows,)."""

    values: Array
    factors: tuple[Array, ...]
    side: Dataset
    joint: int

    @property
    def columns(self) -> Columns:
        """(rows, k factors) products, whitened as the residual is.

        They are computed at each call, because those of all variables together would need much memory.
        """
        products = _side_by_side([self.values * factor[:, None] for factor in self.factors])
        return Columns(self.side.whitened(products, self.joint), self.side.of(self.joint))


@dataclass(frozen=True)
class Shape:
    """A function of one variable at one joint.

    known  (rows,): held-out rows where the variable is in the range that was fitted
    bends  (b, k) of its k coefficients: what a smooth function has little of, its second derivative in units of knots;
           empty where its columns are no values at knots
    """

    name: str
    functions: Split[Functions]
    known: NDArray[np.bool_]
    bends: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def pair(self) -> Pair:
        """Its columns in both sets, computed whenever they are asked for."""
        return self.functions.map(lambda functions: functions.columns)


def shapes_of(bases: Bases, residual: Array, arm: Arm, joint: int) -> Iterator[Shape]:
    """Functions of every variable at one joint, alone and times direction and velocity, whitened as the residual is.

    residual (n * rows,): whitened, of the fit set; the ripples are those of its spectrum.
    """
    fit, held_out, width = bases.fit, bases.held_out, arm.joints[joint - 1].sign_velocity
    factors = []
    for side in (fit, held_out):
        v = side.at_joint("v", joint)
        factors.append((np.ones_like(v), v / np.hypot(v, width), v))
    for name, splines in bases.splines(arm, joint):
        for kinds in ((0,), (1,), (2,), (0, 1)):
            if (kinds != (0,) and name in UNMIXED) or (2 in kinds and " of joint" in name):
                continue
            if len(kinds) > 1 and name not in TWO_FACED:
                continue
            in_fit, in_held_out = (
                Functions(values, tuple(factor[kind] for kind in kinds), side, joint)
                for values, factor, side in zip((splines.fit, splines.held_out), factors, (fit, held_out))
            )
            yield Shape(name, Split(in_fit, in_held_out), splines.known, block_diag(*[splines.bends] * len(kinds)))
    yield from _places(fit, held_out, joint)
    yield from _waves(bases, residual, arm, joint)
    yield from _past(fit, held_out, arm, joint)


def _side_by_side(several: Sequence[Array]) -> Array:
    """(N, k) the columns of all (N, ...), without a copy of a single one."""
    return several[0] if len(several) == 1 else np.hstack(several)


def _places(fit: Dataset, held_out: Dataset, joint: int) -> Iterator[Shape]:
    """Narrow functions of the position, for local effects (a detent, a damaged tooth)."""
    x, x_held_out = fit.at_joint("q", joint), held_out.at_joint("q", joint)
    edges = np.linspace(x.min(), x.max(), PLACES)
    if not np.ptp(x):
        return
    in_range = (x_held_out >= edges[0]) & (x_held_out <= edges[-1])
    in_fit, in_held_out = (
        Functions(
            np.maximum(1.0 - np.abs(values[:, None] - edges) / (edges[1] - edges[0]), 0.0),
            (np.ones(side.rows),),
            side,
            joint,
        )
        for values, side in ((x, fit), (x_held_out, held_out))
    )
    yield Shape("position", Split(in_fit, in_held_out), in_range, bends_of(edges))


def _waves(bases: Bases, residual: Array, arm: Arm, joint: int) -> Iterator[Shape]:
    """The strongest ripples over the motor's angle, alone and times direction, and over the angles of two joints."""
    fit, held_out = bases.fit, bases.held_out
    over, ratio = 1.0 / fit.at_joint("deviation", joint), arm.joints[joint - 1].ratio
    weighted, angle = residual[fit.of(joint)] * over, fit.at_joint("q", joint)
    for direction in (_everywhere, partial(_direction, joint=joint, width=arm.joints[joint - 1].sign_velocity)):
        ripple = _ripple(weighted * direction(fit), angle * ratio)
        if ripple is not None:
            yield _wave("motor angle", fit, held_out, joint, {joint: ripple * ratio}, direction)
    for other in range(1, len(arm) + 1):
        if other != joint and np.ptp(fit.at_joint("q", other)) > 0.0:
            c, d = _plane_wave(weighted, bases.harmonics(joint), bases.harmonics(other))
            name = f"position and position of joint {other}"
            yield _wave(name, fit, held_out, joint, {joint: c, other: d}, _everywhere)


def _everywhere(side: Dataset) -> Array:
    return np.ones(side.rows)


def _direction(side: Dataset, joint: int, width: float) -> Array:
    """(rows,) direction of motion of a joint, as Coulomb friction follows it."""
    v = side.at_joint("v", joint)
    return np.asarray(v / np.hypot(v, width))


def _wave(
    name: str,
    fit: Dataset,
    held_out: Dataset,
    joint: int,
    along: Mapping[int, float],
    factor: Callable[[Dataset], Array],
) -> Shape:
    """A wave times a factor. along: joint (from 1) -> rad of the wave per rad (m) of its angle.

    It is as large as the filter of the residual lets a wave through, whose frequency is that of these angles' speed.
    """
    sides = []
    for side in (fit, held_out):
        phase, speed = (sum(k * side.at_joint(of, j) for j, k in along.items()) for of in ("q", "v"))
        size = factor(side) * low_pass_gain(np.abs(speed) / (2 * np.pi), COMPARE_BAND)
        sides.append(Functions(np.stack([np.sin(phase), np.cos(phase)], axis=1), (size,), side, joint))
    return Shape(name, Split(sides[0], sides[1]), np.ones(held_out.rows, bool))


def _ripple(weighted: Array, motor: Array) -> float | None:
    """Cycles per motor revolution of the strongest ripple over motor angle (rows,) rad; None below two turns."""
    if np.ptp(motor) < 4 * np.pi:
        return None
    # the residual summed in fine bins of the motor's turns has the ripple as a line of its spectrum
    turns = (motor - motor.min()) / (2 * np.pi)
    bins = BINS_PER_TURN * int(2 ** np.ceil(np.log2(2 * turns.max() + 2)))
    total = np.bincount((turns * BINS_PER_TURN).astype(int), weights=weighted, minlength=bins)
    cycles = np.fft.rfftfreq(bins, 1.0 / BINS_PER_TURN)
    power = np.abs(np.fft.rfft(total))
    in_band = (cycles >= CYCLES[0]) & (cycles <= CYCLES[1])
    return float(cycles[in_band][int(np.argmax(power[in_band]))])


def _plane_wave(weighted: Array, angle: Array, other_angle: Array) -> tuple[float, float]:
    """c and d, rad/rad, of the strongest wave sin(c own + d other) that depends on both angles.

    weighted (m,): residual; angle, other_angle (2 steps, m): ``shared_bases.harmonics_of`` both angles.
    """
    steps = len(WAVE_STEPS)
    products = ((angle * weighted) @ other_angle.T).reshape(2, steps, 2, steps)
    cc, cs, sc, ss = products[0, :, 0], products[0, :, 1], products[1, :, 0], products[1, :, 1]
    power = np.concatenate([np.hypot(cc + ss, cs - sc), np.hypot(cc - ss, cs + sc)])
    c = np.concatenate([-WAVE_STEPS, WAVE_STEPS])
    best = np.unravel_index(int(np.argmax(power)), power.shape)
    return float(c[best[0]]), float(WAVE_STEPS[best[1]])


def _past(fit: Dataset, held_out: Dataset, arm: Arm, joint: int) -> Iterator[Shape]:
    """Functions of the history of the current: play operators of several widths (Prandtl and Ishlinskii).

    The current is the one that the model expects: the measured one contains the residual and would explain itself.
    """
    currents = [[np.asarray(signals_of(run, arm, joint).current) for run in side.runs] for side in (fit, held_out)]
    travel = max(float(np.ptp(current)) for current in currents[0])
    if travel == 0.0:
        return
    pair = []
    for side, of_side in zip((fit, held_out), currents):
        plays = [_play(current, np.array(PLAYS) * travel) - current[:, None] for current in of_side]
        pair.append(Functions(np.concatenate(plays), (np.ones(side.rows),), side, joint))
    yield Shape("current and its past", Split(pair[0], pair[1]), np.ones(held_out.rows, bool))


def _play(values: Array, widths: Array) -> Array:
    """(m, k) outputs of play operators of half-widths (k,) on values (m,), each at rest on the first of them.

    Row by row, a play operator clamps its last output to value +- width. Clamps one after the other are one clamp, so
    that those of all rows up to each are found in log2(m) steps, exactly (Hillis & Steele, Communications of the ACM
    29, 1986).
    """
    low, high = values[:, None] - widths, values[:, None] + widths
    reach = 1
    while reach < len(values):
        # rows up to here after those up to ``reach`` before: their bounds, clamped by these
        low[reach:], high[reach:] = (
            np.minimum(np.maximum(before, low[reach:]), high[reach:]) for before in (low[:-reach], high[:-reach])
        )
        reach *= 2
    return np.asarray(np.minimum(np.maximum(values[0], low), high), float)
