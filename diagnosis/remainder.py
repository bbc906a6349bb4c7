"""What no effect of the catalogue explains, and what it depends on: smooth functions of one variable beside the named causes.

For every joint and every variable that a torque or a reading could hang on, a spline of the variable (also times the
direction, or times the velocity, of the joint) is fitted beside the causes and judged on the held-out recordings like a cause. What enters is
structure that the catalogue does not know. A cause that such a function makes superfluous was the nearest name for something else, and
loses it: a spring that is part of a wavy torque over position is no spring.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from arm_model.description import Arm
from diagnosis.library import Columns, Side
from diagnosis.selection import Accepted, Pair, gain_of
from diagnosis.significance import benjamini_hochberg, p_value

Array = NDArray[np.float64]

KNOTS = 12
"""Of a function of one variable: enough for three cycles over the range of a joint."""
MATTERS = 0.15
"""A structure must explain this share of a joint's noise energy ..."""
OF_EXPLAINED = 0.02
"""... and this share of what the causes explain there: a law that is right to a seventh of its amplitude is the right law."""
CERTAIN = 1e-3
"""Probability at which structure may be called by chance: there is no second look at it, as there is at a cause."""
MOST = 3
"""Structures looked for at one joint."""
CYCLES = (0.5, 40.0)
"""Cycles a motor revolution between which a ripple is looked for."""
BINS_PER_TURN = 256


UNMIXED = ("velocity", "acceleration", "current")
"""Variables whose functions are not multiplied by the direction or the velocity: they contain it, or it means nothing."""


@dataclass(frozen=True)
class Structure:
    """``share`` of the variance of a joint's held-out residual (or of the tracker's points, joint None) that is predictable from ``against``."""

    signal: str
    joint: int | None
    against: str
    share: float


@dataclass(frozen=True)
class Remainder:
    """Structures, and the columns that describe them."""

    structures: list[Structure]
    pairs: list[Pair]


def variables(side: Side, arm: Arm, joint: int) -> Iterator[tuple[str, Array]]:
    """Name and values (rows,) of everything that a residual of this joint is held against."""

    def gathered(name: str, of: int = joint) -> Array:
        return np.concatenate([getattr(run, name)[:, of - 1] for run in side.runs])

    yield "time", np.concatenate([run.t for run in side.runs])
    yield "position", gathered("q")
    yield "motor angle", np.mod(gathered("q") * arm.joints[joint - 1].ratio, 2 * np.pi)
    yield "velocity", gathered("v")
    yield "acceleration", gathered("a")
    yield "load torque", gathered("rigid")
    yield "current", gathered("current")
    for other in range(1, len(arm) + 1):
        if other != joint:
            yield f"position of joint {other}", gathered("q", other)
            yield f"velocity of joint {other}", gathered("v", other)
            yield f"current of joint {other}", gathered("current", other)


def structure_left(fit: Side, held_out: Side, accepted: Accepted, arm: Arm) -> Remainder:
    """Structures beside what is ``accepted``, joint by joint, the strongest first."""
    found, pairs = [], []
    for joint in range(1, len(arm) + 1):
        shapes = list(_shapes(fit, held_out, arm, joint))
        here: list[Pair] = []
        for _ in range(MOST):
            best = _strongest(shapes, beside(accepted, here), fit, held_out, joint)
            if best is None:
                break
            name, pair, share = best
            found.append(Structure("current", joint, name, share))
            here.append(pair)
            shapes = [one for one in shapes if one.name != name]
        pairs += here
    return Remainder(found, pairs)


def better_than_causes(fit: Side, held_out: Side, without: Accepted, having: Accepted, arm: Arm, joint: int) -> bool:
    """Whether one function of one variable, in place of the causes of a joint (``without`` them), leaves significantly less than they do.

    A complete cause is never beaten: a function of one variable can only come near it. One that is not the cause at all is.
    """
    rows = held_out.of(joint)
    for shape in _shapes(fit, held_out, arm, joint):
        _, c, _ = gain_of(shape.pair, without, held_out)
        inside = shape.pair[0].dot(without.basis).T @ c
        by_function = without.held_out - shape.pair[1].spread(c, len(held_out.y)) + without.to_held_out @ inside
        less = (having.held_out**2 - by_function**2)[rows] * shape.known
        blocks = np.bincount(held_out.block[rows], weights=less).astype(float)
        if blocks.sum() > MATTERS * held_out.rows and p_value(blocks) < CERTAIN:
            return True
    return False


def _strongest(
    shapes: Sequence[_Shape], accepted: Accepted, fit: Side, held_out: Side, joint: int
) -> tuple[str, Pair, float] | None:
    """The variable whose function explains most of a joint's held-out residual: name, columns, share of the residual's variance."""
    gains = [gain_of(shape.pair, accepted, held_out)[2] for shape in shapes]
    q = benjamini_hochberg(np.array([p_value(one) for one in gains]))
    rows = held_out.of(joint)
    before = float(np.sum(accepted.held_out[rows] ** 2))
    explained = float(np.sum(held_out.y[rows] ** 2)) - before
    enough = max(MATTERS * held_out.rows, OF_EXPLAINED * explained)
    able = [k for k, one in enumerate(gains) if q[k] < CERTAIN and one.sum() > enough]
    if not able:
        return None
    best = max(able, key=lambda k: float(gains[k].sum()))
    return shapes[best].name, shapes[best].pair, float(gains[best].sum()) / before


def beside(accepted: Accepted, more: Sequence[Pair]) -> Accepted:
    """What is accepted, with more columns fitted to what it left."""
    for pair in more:
        x, x_held_out = _full(pair[0], len(accepted.fit)), _full(pair[1], len(accepted.held_out))
        inside = accepted.basis.T @ x
        x, x_held_out = x - accepted.basis @ inside, x_held_out - accepted.to_held_out @ inside
        u, s, vt = np.linalg.svd(x, full_matrices=False)
        keep = s > 1e-4 * s[0]
        basis, to_held_out = u[:, keep], x_held_out @ (vt[keep].T / s[keep])
        seen = basis.T @ accepted.fit
        accepted = Accepted(
            accepted.fit - basis @ seen,
            accepted.held_out - to_held_out @ seen,
            np.hstack([accepted.basis, basis]),
            np.hstack([accepted.to_held_out, to_held_out]),
            accepted.coefficients,
        )
    return accepted


def _full(columns: Columns, length: int) -> Array:
    whole = np.zeros((length, columns.x.shape[1]))
    whole[columns.where] = columns.x
    return whole


@dataclass(frozen=True)
class _Shape:
    """A function of one variable at one joint; ``known`` (rows,): held-out rows where the variable is in the range that was fitted."""

    name: str
    pair: Pair
    known: NDArray[np.bool_]


def _shapes(fit: Side, held_out: Side, arm: Arm, joint: int) -> Iterator[_Shape]:
    """Functions of every variable at one joint, alone and times direction and velocity, over the deviation of each row."""
    width = arm.joints[joint - 1].sign_velocity
    factors = []
    for side in (fit, held_out):
        v = np.concatenate([run.v[:, joint - 1] for run in side.runs])
        over = 1.0 / np.concatenate([run.deviation[:, joint - 1] for run in side.runs])
        factors.append((over, over * v / np.hypot(v, width), over * v))
    for (name, x), (_, x_held_out) in zip(variables(fit, arm, joint), variables(held_out, arm, joint)):
        if name == "motor angle":
            continue  # by its harmonics, below
        if np.ptp(x) == 0.0:
            continue
        # half where the rows are, half evenly: the ends of a range are passed rarely, and matter
        knots = (np.quantile(x, np.linspace(0.0, 1.0, KNOTS)) + np.linspace(x.min(), x.max(), KNOTS)) / 2
        if np.any(np.diff(knots) <= 0.0):
            continue  # as good as constant
        known = (x_held_out >= knots[0]) & (x_held_out <= knots[-1])
        splines = _splines(x, knots), _splines(x_held_out, knots) * known[:, None]
        for kind in range(3):
            if (kind and name in UNMIXED) or (kind == 2 and " of joint" in name):
                continue
            one, other = (
                Columns(values * factor[kind][:, None], side.of(joint))
                for values, factor, side in zip(splines, factors, (fit, held_out))
            )
            yield _Shape(name, (one, other), known)
    harmonic = _harmonic(fit, arm, joint, factors[0][0])
    if harmonic is not None:
        columns = []
        for side, factor in ((fit, factors[0]), (held_out, factors[1])):
            angle = harmonic * arm.joints[joint - 1].ratio * np.concatenate([run.q[:, joint - 1] for run in side.runs])
            columns.append(
                Columns(np.stack([np.sin(angle), np.cos(angle)], axis=1) * factor[0][:, None], side.of(joint))
            )
        yield _Shape("motor angle", (columns[0], columns[1]), np.ones(held_out.rows, bool))


def _splines(x: Array, knots: Array) -> Array:
    """(rows, knots) natural cubic splines, each 1 at its knot and 0 at all others; constant beyond the ends."""
    values: Array = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(np.clip(x, knots[0], knots[-1]))
    return values


def _harmonic(side: Side, arm: Arm, joint: int, over: Array) -> float | None:
    """Cycles a motor revolution of the strongest ripple in a joint's residual over position; None for a joint that hardly moved."""
    q = np.concatenate([run.q[:, joint - 1] for run in side.runs])
    if np.ptp(q) * arm.joints[joint - 1].ratio < 4 * np.pi:
        return None
    # the residual summed in fine bins of the motor's turns has the ripple as a line of its spectrum
    turns = (q - q.min()) * arm.joints[joint - 1].ratio / (2 * np.pi)
    bins = BINS_PER_TURN * int(2 ** np.ceil(np.log2(2 * turns.max() + 2)))
    total = np.bincount((turns * BINS_PER_TURN).astype(int), weights=side.y[side.of(joint)] * over, minlength=bins)
    cycles = np.fft.rfftfreq(bins, 1.0 / BINS_PER_TURN)
    power = np.abs(np.fft.rfft(total))
    wanted = (cycles >= CYCLES[0]) & (cycles <= CYCLES[1])
    return float(cycles[wanted][int(np.argmax(power[wanted]))])
