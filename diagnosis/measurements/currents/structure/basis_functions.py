"""Functions of one variable (or of two angles) that a residual may depend on where no effect explains it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Variable
from diagnosis.residual.filters import COMPARE_BAND, low_pass_gain
from diagnosis.residual.run import Run
from diagnosis.residual.signals import signals_of
from diagnosis.selection.design import Columns, Dataset, Pair
from identification.selection import Split

KNOTS = 16
"""Knots of a function of one variable: enough for three cycles over the range of a joint."""
PLACES = 100
"""Knots over the range of a joint of the function for local effects, such as a damaged tooth."""
CYCLES = (0.5, 40.0)
"""Cycles per motor revolution between which a ripple is searched for."""
BINS_PER_TURN = 256
UNMIXED = ("velocity", "acceleration", "current")
"""Variables whose functions are not multiplied by direction or velocity, which they contain."""
TWO_FACED = (Variable.POSITION, Variable.LOAD)
"""Variables that may have a function per direction: a gear loses torque where it drives."""
PLAYS = (0.004, 0.01, 0.02, 0.05, 0.1)
"""Half-widths of play operators, of the range of the current."""


def variables(side: Dataset, arm: Arm, joint: int) -> Iterator[tuple[str, Array]]:
    """Name and values (rows,) of every variable that the residual of this joint may depend on."""
    yield "time", np.concatenate([run.t for run in side.runs])
    yield "position", side.at_joint("q", joint)
    yield "motor angle", np.mod(side.at_joint("q", joint) * arm.joints[joint - 1].ratio, 2 * np.pi)
    yield "velocity", side.at_joint("v", joint)
    yield "acceleration", side.at_joint("a", joint)
    yield "load torque", side.at_joint("rigid", joint)
    yield "current", side.at_joint("current", joint)
    for other in range(1, len(arm) + 1):
        if other != joint:
            yield f"position of joint {other}", side.at_joint("q", other)
            yield f"velocity of joint {other}", side.at_joint("v", other)
            yield f"current of joint {other}", side.at_joint("current", other)


@dataclass(frozen=True)
class Shape:
    """A function of one variable at one joint.

    known  (rows,): held-out rows where the variable is in the range that was fitted
    bends  (b, k) of its k coefficients: what a smooth function has little of, its second derivative in units of knots;
           empty where its columns are no values at knots
    """

    name: str
    pair: Pair
    known: NDArray[np.bool_]
    bends: Array = field(default_factory=lambda: np.zeros((0, 0)))


def shapes_of(fit: Dataset, held_out: Dataset, residual: Array, arm: Arm, joint: int) -> Iterator[Shape]:
    """Functions of every variable at one joint, alone and times direction and velocity, over the std of each row.

    residual (n * rows,): whitened, of the fit set; the ripples are those of its spectrum.
    """
    width = arm.joints[joint - 1].sign_velocity
    factors = []
    for side in (fit, held_out):
        v, over = side.at_joint("v", joint), 1.0 / side.at_joint("deviation", joint)
        factors.append((over, over * v / np.hypot(v, width), over * v))
    for (name, x), (_, x_held_out) in zip(variables(fit, arm, joint), variables(held_out, arm, joint)):
        if name == "motor angle":
            continue  # by its harmonics, below
        if np.ptp(x) == 0.0:
            continue
        # half where the rows are, half evenly: the ends of a range are passed rarely, and matter
        knots = (np.quantile(x, np.linspace(0.0, 1.0, KNOTS)) + np.linspace(x.min(), x.max(), KNOTS)) / 2
        if np.any(np.diff(knots) <= 0.0):
            continue  # practically constant
        in_range = (x_held_out >= knots[0]) & (x_held_out <= knots[-1])
        splines = _splines(x, knots), _splines(x_held_out, knots) * in_range[:, None]
        bends = _bends(knots)
        for kinds in ((0,), (1,), (2,), (0, 1)):
            if (kinds != (0,) and name in UNMIXED) or (2 in kinds and " of joint" in name):
                continue
            if len(kinds) > 1 and name not in TWO_FACED:
                continue
            in_fit, in_held_out = (
                Columns(_side_by_side([values * factor[kind][:, None] for kind in kinds]), side.of(joint))
                for values, factor, side in zip(splines, factors, (fit, held_out))
            )
            yield Shape(name, Split(in_fit, in_held_out), in_range, block_diag(*[bends] * len(kinds)))
    yield from _places(fit, held_out, joint)
    yield from _waves(fit, held_out, residual, arm, joint)
    yield from _past(fit, held_out, arm, joint)


def _side_by_side(several: Sequence[Array]) -> Array:
    """The columns of all, without a copy of a single one."""
    return several[0] if len(several) == 1 else np.hstack(several)


def _places(fit: Dataset, held_out: Dataset, joint: int) -> Iterator[Shape]:
    """Narrow functions of the position, for local effects (a detent, a damaged tooth)."""
    x, x_held_out = fit.at_joint("q", joint), held_out.at_joint("q", joint)
    edges = np.linspace(x.min(), x.max(), PLACES)
    if not np.ptp(x):
        return
    in_range = (x_held_out >= edges[0]) & (x_held_out <= edges[-1])
    in_fit, in_held_out = (
        Columns(
            np.maximum(1.0 - np.abs(values[:, None] - edges) / (edges[1] - edges[0]), 0.0)
            / side.at_joint("deviation", joint)[:, None],
            side.of(joint),
        )
        for values, side in ((x, fit), (x_held_out, held_out))
    )
    yield Shape("position", Split(in_fit, in_held_out), in_range, _bends(edges))


def _bends(knots: Array) -> Array:
    """(knots - 2, knots) second derivative at the inner knots of a function of these values, per mean spacing^2."""
    below, above = np.diff(knots)[:-1], np.diff(knots)[1:]
    second = np.zeros((len(knots) - 2, len(knots)))
    inner = np.arange(len(knots) - 2)
    second[inner, inner], second[inner, inner + 2] = 2.0 / (below * (below + above)), 2.0 / (above * (below + above))
    second[inner, inner + 1] = -2.0 / (below * above)
    return second * float(np.mean(np.diff(knots))) ** 2


def _splines(x: Array, knots: Array) -> Array:
    """(rows, knots) natural cubic splines, each 1 at its knot and 0 at all others; constant beyond the ends."""
    values: Array = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(np.clip(x, knots[0], knots[-1]))
    return values


def _waves(fit: Dataset, held_out: Dataset, residual: Array, arm: Arm, joint: int) -> Iterator[Shape]:
    """The strongest ripples over the motor's angle, alone and times direction, and over the angles of two joints."""
    over, ratio = 1.0 / fit.at_joint("deviation", joint), arm.joints[joint - 1].ratio
    weighted, own = residual[fit.of(joint)] * over, fit.at_joint("q", joint)
    for direction in (_everywhere, partial(_direction, joint=joint, width=arm.joints[joint - 1].sign_velocity)):
        ripple = _ripple(weighted * direction(fit), own * ratio)
        if ripple is not None:
            yield _wave("motor angle", fit, held_out, joint, {joint: ripple * ratio}, direction)
    for other in range(1, len(arm) + 1):
        if other != joint and np.ptp(fit.at_joint("q", other)) > 0.0:
            c, d = _plane_wave(weighted, own, fit.at_joint("q", other))
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
    columns = []
    for side in (fit, held_out):
        phase, speed = (sum(k * side.at_joint(of, j) for j, k in along.items()) for of in ("q", "v"))
        size = (
            factor(side) * low_pass_gain(np.abs(speed) / (2 * np.pi), COMPARE_BAND) / side.at_joint("deviation", joint)
        )
        columns.append(Columns(np.stack([np.sin(phase), np.cos(phase)], axis=1) * size[:, None], side.of(joint)))
    return Shape(name, Split(columns[0], columns[1]), np.ones(held_out.rows, bool))


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


def _plane_wave(weighted: Array, own: Array, other: Array) -> tuple[float, float]:
    """c and d, rad/rad, of the strongest wave sin(c own + d other) that depends on both angles."""
    steps = np.arange(0.5, 8.01, 0.5)
    first, second = (_harmonics(np.exp(0.5j * angle), len(steps)) for angle in (own, other))
    # -c and c differ by the conjugate
    power = np.abs(np.concatenate([(part * weighted) @ second.T for part in (first.conj(), first)]))
    c = np.concatenate([-steps, steps])
    best = np.unravel_index(int(np.argmax(power)), power.shape)
    return float(c[best[0]]), float(steps[best[1]])


def _harmonics(wave: Array, count: int) -> Array:
    """(count, m) powers 1 to count of a wave (m,)."""
    return np.multiply.accumulate(np.broadcast_to(wave, (count, len(wave))), axis=0)


def _past(fit: Dataset, held_out: Dataset, arm: Arm, joint: int) -> Iterator[Shape]:
    """Functions of the history of the current: play operators of several widths (Prandtl and Ishlinskii).

    The current is the one that the model predicts for the smoothed motion: the measured one contains the residual and
    would explain itself.
    """
    currents = [[_expected(run, arm, joint) for run in side.runs] for side in (fit, held_out)]
    travel = max(float(np.ptp(current)) for current in currents[0])
    if travel == 0.0:
        return
    pair = []
    for side, of_side in zip((fit, held_out), currents):
        over = 1.0 / side.at_joint("deviation", joint)
        kept = [_play(current, np.array(PLAYS) * travel) - current[:, None] for current in of_side]
        pair.append(Columns(np.concatenate(kept) * over[:, None], side.of(joint)))
    yield Shape("current and its past", Split(pair[0], pair[1]), np.ones(held_out.rows, bool))


def _expected(run: Run, arm: Arm, joint: int) -> Array:
    """(m,) A: load and Coulomb friction of a joint for the smoothed motion."""
    s = signals_of(run, arm, joint)
    current: Array = (s.load + s.coulomb * s.sign) / arm.joints[joint - 1].drive_constant
    return current


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
