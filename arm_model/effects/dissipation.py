"""The set of friction laws that could exist: at every speed within the range, the total friction opposes the motion.

Total friction of a joint is its own viscous and Coulomb friction and its friction curve plus every effect whose torque
depends on the velocity alone (``Effect.friction``). Friction force times velocity must not be negative
(Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994: passivity); a single coefficient may be, such as a
Stribeck term that takes away part of the Coulomb friction at low speed. A constant torque (``offset``) is no friction:
it does no net work.

``diagnose``, ``identify`` and ``read_model`` all use this set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm, EffectTerm, Joint
from arm_model.effects.catalogue import CATALOGUE, values_of
from arm_model.effects.definition import Effect, Signals
from arm_model.rigid_body.friction_curve import curve_at

POINTS = 25
"""Speeds looked at over each range."""
REACH = 3.0
"""Times the speed that an effect names: there its law has ended (exp(-9))."""
ROUNDING = 1e-9
"""Of a joint's largest friction: less than this along the motion counts as none."""


def friction_terms(arm: Arm, joint: int) -> list[EffectTerm]:
    """Effects of the arm that are friction of a joint (from 0), a function of its velocity alone."""
    return [term for term in arm.effects if term.joint == joint + 1 and CATALOGUE[term.name].friction]


def speeds(arm: Arm, joint: int, top: float) -> Array:
    """(k,) rad/s (m/s), from 0 on, at which the friction of a joint (from 0) is judged.

    Up to the drive's speed limit where the model states one, to ``top``, and over the speeds that its effects name.
    """
    drive = arm.joints[joint]
    curve_speeds = () if drive.friction_curve is None else drive.friction_curve.speed
    ends = [top, *curve_speeds[-1:], 0.0 if drive.motor_speed_limit is None else drive.motor_speed_limit / drive.ratio]
    for term in friction_terms(arm, joint):
        names = [p.name for p in CATALOGUE[term.name].nonlinear if p.unit == "rad/s"]
        ends += [REACH * term.parameters.get(name, 0.0) for name in names]
    # just above standstill, too: there nothing but the viscous friction is left of a joint without Coulomb friction
    end = max(ends) or 1.0
    return np.unique(
        np.concatenate([[0.0, 1e-6 * end], curve_speeds, *(np.linspace(0.0, up, POINTS) for up in ends if up > 0)])
    )


def effect_friction(effect: Effect, given: dict[str, float], v: Array, direction: int, t: float = 0.0) -> Array:
    """(k,) N m (N) against the motion, of a friction effect at speeds v (k,) >= 0 in a direction (1 or -1).

    t: s since the start of the recording or the simulation.
    """
    seen = Signals(v=direction * v, sign=float(direction), t=t)
    law = effect.torque
    assert law is not None, "a friction effect has a torque"
    return np.broadcast_to(np.asarray(direction * law(values_of(effect, given), seen), float), v.shape)


def total_friction(arm: Arm, joint: int, v: Array, direction: int, t: float = 0.0) -> Array:
    """(k,) N m (N) against the motion, of all friction of a joint (from 0) at speeds v (k,) >= 0 in a direction.

    t: s since the start of the recording or the simulation.
    """
    drive, side = arm.joints[joint], 0 if direction > 0 else 1
    of_drive = drive.ratio * drive.coulomb[side] + drive.ratio**2 * drive.viscous[side] * v
    if drive.friction_curve is not None:
        of_drive = of_drive + curve_at(drive.friction_curve, v, direction)
    terms = friction_terms(arm, joint)
    return np.asarray(
        of_drive + sum(effect_friction(CATALOGUE[term.name], term.parameters, v, direction, t) for term in terms), float
    )


def _least_in_time(arm: Arm, joint: int, v: Array, direction: int) -> Array:
    """(k,) N m (N): total friction at the start, or when all that changes has changed, whichever is less."""
    return np.minimum(*(total_friction(arm, joint, v, direction, t) for t in (0.0, np.inf)))


def least_friction(arm: Arm, joint: int, top: float = 0.0) -> tuple[float, float]:
    """(rad/s, N m) or (m/s, N): velocity at which a joint's (from 0) friction is least, and that friction.

    Negative where it drives the joint there; never by rounding alone.
    """
    v = speeds(arm, joint, top)
    both = {direction: _least_in_time(arm, joint, v, direction) for direction in (1, -1)}
    scale = max(float(np.abs(values).max()) for values in both.values())
    direction = min(both, key=lambda d: float(both[d].min()))
    at = int(np.argmin(both[direction]))
    least = float(both[direction][at])
    return direction * float(v[at]), 0.0 if -ROUNDING * scale <= least < 0.0 else least


def driven(arm: Arm, top: Sequence[float] | Array | None = None) -> list[int]:
    """Joints (from 0) that their own friction drives at some speed up to ``top`` (n,)."""
    tops = [0.0] * len(arm) if top is None else top
    return [j for j in range(len(arm)) if least_friction(arm, j, float(tops[j]))[1] < 0.0]


def problem(arm: Arm) -> str | None:
    """One line about the first joint whose friction drives it; None for an arm without any."""
    for j in driven(arm):
        v, torque = least_friction(arm, j)
        units = ("rad/s", "N m") if arm.joints[j].revolute else ("m/s", "N")
        return (
            f"joint[{j + 1}]: its friction (viscous, coulomb, friction_curve and effects together) drives it with "
            f"{-torque:.3g} {units[1]} at {v:.3g} {units[0]}; it must oppose the motion at every speed (or give the "
            "reason why not in 'unphysical')"
        )
    return None


def dissipative(arm: Arm, top: Sequence[float] | Array | None = None) -> Arm:
    """The arm with the nearest friction that opposes the motion at every speed up to ``top`` (n,); itself if it does.

    Effects stay; viscous and Coulomb friction of the joint change, the least in torque at its highest speed.
    """
    joints, driving = list(arm.joints), list(driven(arm, top))
    if not driving:
        return arm
    for j in driving:
        v = speeds(arm, j, 0.0 if top is None else float(top[j]))
        joints[j] = _projected(joints[j], v, [_least_in_time(arm, j, v, direction) for direction in (1, -1)])
    return replace(arm, joints=tuple(joints))


def _projected(joint: Joint, v: Array, friction: Sequence[Array]) -> Joint:
    """A joint with changed viscous and Coulomb friction: least distance problem (Lawson, Hanson, 1974, chapter 23)."""
    # here, not above: reading a model file need not load scipy
    from scipy import optimize

    coulomb, viscous = list(joint.coulomb), list(joint.viscous)
    for side, values in enumerate(friction):
        if values.min() >= 0.0:
            continue
        a = np.stack([np.ones_like(v), v / v[-1]], axis=1)
        # a rounding's worth inside
        h = 10 * ROUNDING * np.abs(values).max() - values
        r = np.array([0.0, 0.0, 1.0]) - np.vstack([a.T, h]) @ optimize.nnls(np.vstack([a.T, h]), np.eye(3)[2])[0]
        more = -r[:2] / r[2]
        coulomb[side] += float(more[0]) / joint.ratio
        viscous[side] += float(more[1]) / v[-1] / joint.ratio**2
    return replace(joint, coulomb=(coulomb[0], coulomb[1]), viscous=(viscous[0], viscous[1]))
