"""An arm under a torque controller, in air or water with all its effects, simulated by the compiled engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.control.computed_torque import Reference
from arm_model.description import Arm
from arm_model.simulation.stepper import Stepper


class TorqueController(Protocol):
    """Decides the torques: ``torque`` at every tick, then ``observe`` with the torque that the drives gave."""

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array: ...

    def observe(self, q: Array, qd: Array, applied: Array) -> None: ...


@dataclass(frozen=True)
class Run:
    """A run under torque control: times (R,) s, and (R, n) of each quantity below.

    These are motor angle over gear (rad), its rate (rad/s), torque given from then on (N m), demanded position (rad).
    """

    t: Array
    q: Array
    qd: Array
    torque: Array
    demand: Array


def controlled(
    arm: Arm,
    controller: TorqueController,
    demand: Callable[[float], Reference],
    *,
    duration: float,
    period: float,
    start: Array | None = None,
) -> Run:
    """The motion of an arm, from rest at ``start``, under a controller that is called every ``period`` s.

    The controller gets what the motors' encoders read.

    Torques are cut at each joint's torque_limit and held for a period, a whole number of the engine's steps. The servos
    of the model, if it has any, are out of play. InputError: a period that is no whole number of steps, or an arm that
    runs away.
    """
    n = len(arm)
    stepper = Stepper(replace(arm, controller=None), demand(0.0).q if start is None else np.asarray(start, float))
    steps = round(period / stepper.period)
    if steps < 1 or abs(steps * stepper.period - period) > 1e-9:
        raise InputError("period", f"is {period:g} s; expected a whole number of steps of {stepper.period:g} s")
    limits = np.array([np.inf if joint.torque_limit is None else joint.torque_limit for joint in arm.joints])
    drive = arm.joint_array("drive_constant")
    count = int(np.floor(duration / period + 1e-9)) + 1
    t: Array = period * np.arange(count, dtype=np.float64)
    q, qd, given, asked = np.empty((4, count, n))
    for k in range(count):
        q[k], qd[k] = stepper.motors
        if not (np.isfinite(q[k]).all() and np.isfinite(qd[k]).all()):
            raise InputError(arm.name, f"runs away at {t[k]:.3g} s; use a shorter period or lower gains")
        reference = demand(float(t[k]))
        asked[k] = reference.q
        given[k] = np.clip(controller.torque(q[k], qd[k], reference), -limits, limits)
        controller.observe(q[k], qd[k], given[k])
        stepper.advance(np.tile(given[k] / drive, (steps, 1)), np.empty(0))
    return Run(t, q, qd, given, asked)
