"""States of transmissions and bristles along recorded rows, by steps that are exact for the law between two rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import blas

from arm_io.types import Array
from arm_model.effects import Effect, Signals, Values
from diagnosis.residual.filters import Motion
from diagnosis.residual.gap import NO_INERTIA

HELD = 0.5
"""Of its stiffness, at least, a spring keeps against a load that grows as it gives way: a softer one holds no link."""


def spring_twist(
    load: Array, inertia: Array, stiffness: float, damping: float, step: float, eased: Array | float = 0.0
) -> Motion:
    """Twist of an elastic joint, its rate and second rate (m,), for rows ``step`` s apart.

    The motor follows its own motion; the link, of ``inertia`` (m,) kg m2, would need ``load`` (m,) N m to follow it
    stiffly, and oscillates behind the spring instead: (inertia d')' + damping d' + (stiffness + eased) d = load, by
    exact steps with all as it is in the middle of each; at rest at the start. The momentum is that of an inertia which
    other joints change as they move: the part of the load that is proportional to the link's own speed, less of which
    acts on a link that lags behind. A link without inertia only follows its load.
    stiffness N m/rad, damping N m s/rad; eased (m,) N m/rad: by how much less load a link has per rad that it is
    behind, as gravity lifts a pendulum less. It is a tenth of the stiffness of a soft spring.
    """
    held = _held(stiffness, eased, load)
    if not (inertia > NO_INERTIA).all():
        follows = load / held
        speed = np.gradient(follows, step)
        return follows, speed, np.gradient(speed, step)
    torque, spring = _between(load), _between(held)
    stay, go, back, keep = _steps(inertia, held, damping, step)
    settled = torque / spring
    # with x the deviation of (twist, rate) from (settled, 0), each step is x = [[stay, go], [back, keep]] x
    forced = (1.0 - stay) * settled, -back * settled
    twist, rate = _recurrence((stay, go, back, keep), forced, (load[0] / held[0], 0.0))
    return twist, rate, (load - held * twist - (damping + np.gradient(inertia, step)) * rate) / inertia


def swings(inertia: Array, stiffness: float, damping: float, step: float, eased: Array) -> list[Motion]:
    """Twist of a joint without load, its rate and second rate (m,), from (1, 0) and from (0, 1) at the first row.

    As in ``spring_twist``, whose joint was at rest before. A link that was moved before a recording still swings as it
    begins. Empty for a link without inertia, which does not.
    """
    if not (inertia > NO_INERTIA).all():
        return []
    held = _held(stiffness, eased, inertia)
    steps, nothing = _steps(inertia, held, damping, step), np.zeros(len(inertia))
    damped = damping + np.gradient(inertia, step)
    free = [_recurrence(steps, (nothing, nothing), start) for start in ((1.0, 0.0), (0.0, 1.0))]
    return [(twist, rate, -(held * twist + damped * rate) / inertia) for twist, rate in free]


def _held(stiffness: float, eased: Array | float, rows: Array) -> Array:
    """(m,) N m/rad: what of a stiffness is left where the load falls by ``eased`` per rad; as many as ``rows``."""
    return np.broadcast_to(np.maximum(stiffness + eased, HELD * stiffness), rows.shape)


def _between(rows: Array) -> Array:
    """Means (m,) of each row and the next; the last as it is."""
    return np.append((rows[1:] + rows[:-1]) / 2, rows[-1:])


def _steps(inertia: Array, held: Array, damping: float, step: float) -> tuple[Array, Array, Array, Array]:
    """(m,) each: [[stay, go], [back, keep]], by which twist and rate of a free link follow from those a row before."""
    mass, spring = _between(inertia), _between(held)
    decay = (damping + np.append(np.diff(inertia) / step, 0.0)) / mass / 2
    even, odd = _free_motion(spring / mass, decay, step)
    return even + decay * odd, odd, -spring / mass * odd, even - decay * odd


def _free_motion(square: Array, decay: Array, step: float) -> tuple[Array, Array]:
    """e^(-decay step) cos(w step) and e^(-decay step) sin(w step) / w: of d'' + 2 decay d' + square d = 0.

    w^2 = square - decay^2. Where it is negative the motion is the sum of two exponentials, written without cancelling.
    step s, decay 1/s, square 1/s2.
    """
    remaining = square - decay**2
    w = np.sqrt(np.maximum(np.abs(remaining), 1e-9))
    shrink = np.exp(-decay * step)
    even, odd = shrink * np.cos(w * step), shrink * np.sin(w * step) / w
    creeps = remaining < 0.0
    if creeps.any():
        w, decay, square = w[creeps], decay[creeps], square[creeps]
        slow, quick = np.exp(-square / (decay + w) * step), np.exp(-(decay + w) * step)
        even[creeps], odd[creeps] = (slow + quick) / 2, (slow - quick) / (2 * w)
    return even, odd


def _recurrence(
    steps: tuple[Array, Array, Array, Array], forced: tuple[Array, Array], start: tuple[float, float]
) -> tuple[Array, Array]:
    """d, v (m,): d' = stay d + go v + forced, v' = back d + keep v + forced_rate, row by row from ``start``.

    steps: stay, go, back, keep. The steps are a triangular system of bandwidth four in d0, v0, d1, v1, ..., which BLAS
    solves forwards, as a loop would.
    """
    stay, go, back, keep = steps
    band = np.zeros((4, 2 * len(stay)), order="F")
    band[2, ::2], band[3, ::2], band[1, 1::2], band[2, 1::2] = -stay, -back, -go, -keep
    right = np.empty(2 * len(stay))
    right[:2], right[2::2], right[3::2] = start, forced[0][:-1], forced[1][:-1]
    solved = blas.dtbsv(3, band, right, lower=1, diag=1, overwrite_x=1)
    return solved[::2], solved[1::2]


def spring_of(effect: Effect, values: Values) -> tuple[float, float] | None:
    """Stiffness and damping of a transmission that is a spring; None for one with play, or a stiff one."""
    if effect.spring is None or effect.gap is not None:
        return None
    return float(effect.spring(values, Signals(twist=1.0))), float(effect.spring(values, Signals(twist_rate=1.0)))


def in_series(springs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Stiffness and damping of springs (k, c) one behind the other: 1 / k and c / k^2 add up, the last to first order.

    As ``arm_model.system`` has them.
    """
    stiffness = 1.0 / sum(1.0 / k for k, _ in springs)
    return stiffness, stiffness**2 * sum(c / k**2 for k, c in springs)


def integrated(effect: Effect, p: Values, s: Signals, step: float) -> Array:
    """State (m,) of an effect along rows ``step`` s apart, by exponential steps: its rate is affine in the state.

    Between two rows the rate is the mean of both: with that of the first alone the state is half a row late, which
    looks like damping.
    """
    assert effect.rate is not None
    at0 = np.broadcast_to(np.asarray(effect.rate(p, replace(s, state=0.0)), float), s.v.shape)
    slope = np.broadcast_to(np.asarray(effect.rate(p, replace(s, state=1.0)), float), s.v.shape) - at0
    at0, slope = (np.append((rate[:-1] + rate[1:]) / 2.0, rate[-1]) for rate in (at0, slope))
    grow = np.exp(np.minimum(slope * step, 0.0))
    stiff = np.abs(slope) > 1e-9
    forced = np.where(stiff, at0 * (grow - 1.0) / np.where(stiff, slope, 1.0), at0 * step)
    # state' = grow state + forced, row by row from 0: a triangular system of bandwidth two
    band = np.zeros((2, len(grow)), order="F")
    band[1] = -grow
    solved: Array = blas.dtbsv(1, band, np.append(0.0, forced[:-1]), lower=1, diag=1)
    return solved
