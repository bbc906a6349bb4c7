"""Where a tracker sees its target, by the laws of ``arm_model.effects``: links sag, points come late or are wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, Signals, described, values_of
from arm_model.rigid_body.gravity_level import gravity_levels
from arm_model.rigid_body.kinematics import link_frames
from arm_model.rigid_body.numeric import rigid_torque


def target_at(arm: Arm, q: Array, point: Sequence[float] | Array) -> Array:
    """(R, 3) m in the base frame: a ``point`` (3,) m of the last link's frame, at link-side angles q (R, n) rad (m).

    With the arm's geometry as its effects make it, and its links hanging (effects with a ``bend``) under their weight.
    """
    last = link_frames(described(arm), q + bends(arm, q))[:, -1]
    return np.asarray(last[:, :3, :3] @ np.asarray(point, float) + last[:, :3, 3], float)


def lost_motion(arm: Arm, q: Array, load: Array) -> Array:
    """(R, n) rad (m) by which motors, at q (R, n) over their gears, are ahead of links of which they bear the load.

    By the springs, gaps and gears that are effects of the arm; load (R, n) N m (N) at the motors.
    """
    ahead = np.zeros_like(q)
    for term in arm.effects:
        effect, j = CATALOGUE[term.name], (term.joint or 1) - 1
        if effect.deflection is not None:
            signals = Signals(motor=q[:, j] * arm.joints[j].ratio, load=load[:, j])
            ahead[:, j] += effect.deflection(values_of(effect, term.parameters), signals)
    return ahead


def latency(arm: Arm) -> float:
    """s by which the arm's effects make tracked points late."""
    delay = 0.0
    for term in arm.effects:
        effect = CATALOGUE[term.name]
        if effect.late is not None:
            delay += float(effect.late(values_of(effect, term.parameters), Signals()))
    return delay


def tracked(arm: Arm, t: Array, q: Array, point: Sequence[float] | Array) -> Array:
    """(R, 3) m in the base frame: what a tracker says of ``target_at`` over a motion q (R, n) at t (R,) s.

    Late points are those of earlier angles, interpolated (cubic; the first row stays before it). Wrong ones are the
    same at every call.
    """
    delay = latency(arm)
    if delay and len(t) > 1:
        from scipy.interpolate import CubicSpline

        q = np.asarray(CubicSpline(t, q, axis=0)(np.clip(t - delay, t[0], t[-1])), float)
    points = target_at(arm, q, point)
    generator = np.random.default_rng(0)
    for term in arm.effects:
        effect = CATALOGUE[term.name]
        if effect.stray is not None:
            drawn = Signals(state=generator.uniform(size=len(t)))
            distance = np.asarray(effect.stray(values_of(effect, term.parameters), drawn), float)
            way = generator.normal(size=(len(t), 3))
            points += distance[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
    return points


def bends(arm: Arm, q: Array) -> Array:
    """(R, n) rad by which each link gives way at link-side joint angles q (R, n)."""
    real = described(arm)
    deflections = np.zeros_like(q)
    terms = [(CATALOGUE[term.name], term) for term in arm.effects if CATALOGUE[term.name].bend is not None]
    if terms:
        still = np.zeros_like(q)
        holding = rigid_torque(replace(real, effects=()), q, still, still)
        for effect, term in terms:
            j = (term.joint or 1) - 1
            assert effect.bend is not None
            values = values_of(effect, term.parameters)
            seen = Signals(q=q[:, j], load=holding[:, j])
            if effect.driven:
                along, across = gravity_levels(real, q, int(values.driver))[:, j].T
                seen = replace(seen, driver=q[:, int(values.driver) - 1], along=along, across=across)
            deflections[:, j] += effect.bend(values, seen)
    return deflections
