"""An arm driven by torques that a table or a controller gives, in air or in water."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from arm_model.control.computed_torque import Wanted
from arm_model.description import Arm
from arm_model.dynamics import forward_dynamics
from arm_model.hydrodynamics import Torque, accelerations
from inputs import InputError

Array = NDArray[np.float64]


class TorqueController(Protocol):
    """What decides torques: ``torque`` at every tick, then ``told`` what the drives made of it."""

    def torque(self, q: Array, qd: Array, wanted: Wanted) -> Array: ...

    def told(self, q: Array, qd: Array, applied: Array) -> None: ...


@dataclass(frozen=True)
class Run:
    """(R,) s, and (R, n) each: joint angle, rate, torque given from then on, demanded position; rad, rad/s, N m."""

    t: Array
    q: Array
    qd: Array
    torque: Array
    demand: Array


def pushed(
    arm: Arm,
    torque: Callable[[float], Array],
    *,
    duration: float,
    step: float,
    start: Array,
    around: Torque | None = None,
) -> Run:
    """The arm from rest at ``start`` (n,) under torque(t) (n,), held over every ``step`` s (Runge-Kutta, fourth order)."""
    return _run(arm, lambda t, q, qd: torque(t), duration, step, start, around, None)


def controlled(
    arm: Arm,
    controller: TorqueController,
    demand: Callable[[float], Wanted],
    *,
    duration: float,
    period: float,
    around: Torque | None = None,
    start: Array | None = None,
) -> Run:
    """The arm under a controller that is called every ``period`` s; torques are cut at each joint's torque_limit and held."""
    limits = [np.inf if joint.torque_limit is None else joint.torque_limit for joint in arm.joints]

    def torque(t: float, q: Array, qd: Array) -> Array:
        applied = np.clip(controller.torque(q, qd, demand(t)), np.negative(limits), limits)
        controller.told(q, qd, applied)
        return applied

    start = demand(0.0).q if start is None else start
    return _run(arm, torque, duration, period, start, around, demand)


def _run(
    arm: Arm,
    torque: Callable[[float, Array, Array], Array],
    duration: float,
    step: float,
    start: Array,
    around: Torque | None,
    demand: Callable[[float], Wanted] | None,
) -> Run:
    n, count = len(arm), int(np.floor(duration / step + 1e-9)) + 1
    if np.shape(start) != (n,):
        raise InputError("start", f"has shape {np.shape(start)}; ({n},) is wanted for this arm")
    t: Array = step * np.arange(count, dtype=np.float64)
    state, rows, given = np.concatenate([start, np.zeros(n)]), np.empty((count, 2 * n)), np.empty((count, n))
    for k in range(count):
        rows[k] = state
        tau = given[k] = torque(float(t[k]), state[:n], state[n:])
        state = state + step * _slope(arm, around, state, tau, step)
        if not np.isfinite(state).all():
            raise InputError(arm.name, f"runs away at {t[k]:.3g} s; a shorter step or lower gains are wanted")
    wanted = rows[:, :n] if demand is None else np.stack([demand(float(now)).q for now in t])
    return Run(t, rows[:, :n], rows[:, n:], given, wanted)


def _slope(arm: Arm, around: Torque | None, state: Array, tau: Array, step: float) -> Array:
    """Mean rate of (q, q') over a step: the fourth-order Runge-Kutta average."""

    def rate(at: Array) -> Array:
        q, qd = at[None, : len(arm)], at[None, len(arm) :]
        if around is None:
            qdd = forward_dynamics(arm, q, qd, tau[None])
        else:
            qdd = accelerations(arm, around, q, qd, tau[None])
        return np.concatenate([qd[0], qdd[0]])

    k1 = rate(state)
    k2 = rate(state + step / 2 * k1)
    k3 = rate(state + step / 2 * k2)
    return np.asarray((k1 + 2 * k2 + 2 * k3 + rate(state + step * k3)) / 6)
