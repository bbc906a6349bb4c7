"""What the instruments show of a motion: the effects of sensing and timing, by the laws of ``arm_model.effects``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, Effect, Signals, Values, values_of
from arm_model.motion import Motion


@dataclass(frozen=True)
class Readings:
    """What the instruments read: q (..., R, n) rad, the motor encoder over the gear ratio, as ``Motion.qm``.

    Also the current (..., R, n) A as the transducer shows it.
    """

    q: Array
    current: Array


def recorded(arm: Arm, motion: Motion) -> Readings:
    """What a recording of ``motion`` holds.

    Delayed currents are interpolated between rows (cubic; the first row stays before it). What no effect changes is
    that of the motion itself, not a copy. InputError for an effect of a joint that names none.
    """
    q, current = motion.qm, motion.current
    terms = [
        (CATALOGUE[term.name], term.joint, values_of(CATALOGUE[term.name], term.parameters)) for term in arm.effects
    ]
    for effect, _, values in terms:
        if effect.delay is not None:
            late = np.broadcast_to(np.asarray(effect.delay(values, Signals(t=motion.t)), float), motion.t.shape)
            current = _at(motion.t, current, motion.t - late)
    if any(effect.angle is not None or effect.current is not None for effect, _, _ in terms):
        q, current = q.copy(), current.copy()
    for effect, joint, values in terms:
        if effect.angle is not None or effect.current is not None:
            if joint is None:
                raise InputError(effect.name, "needs a joint")
            j = joint - 1
            q[..., j], current[..., j] = _shown(arm, motion, j, effect, values, q[..., j], current[..., j])
    return Readings(q, current)


def _shown(
    arm: Arm, motion: Motion, j: int, effect: Effect, values: Values, q: Array, current: Array
) -> tuple[Array, Array]:
    seen = Signals(
        q=motion.q[..., j],
        v=motion.qmd[..., j],
        motor=motion.qm[..., j] * arm.joints[j].ratio,
        current=current,
        torque=motion.torque[..., j],
        t=motion.t,
    )
    if effect.angle is not None:
        q = q + effect.angle(values, seen)
    if effect.current is not None:
        current = current + effect.current(values, seen)
    return q, current


def _at(t: Array, values: Array, wanted: Array) -> Array:
    """``values`` (..., R, n) at other times (R,); a lane that is not finite throughout is NaN."""
    from scipy.interpolate import CubicSpline

    if len(t) < 2 or not np.any(wanted != t):
        return values
    stable = np.isfinite(values).all(axis=(-2, -1), keepdims=True)
    spline = CubicSpline(t, np.where(stable, values, 0.0), axis=-2)
    return np.where(stable, spline(np.clip(wanted, t[0], t[-1])), np.nan)
