"""The arm of a simulated rig: ``arm_model``'s computed dynamics under its servos, as the plant of a ``World``.

What an experiment's ``setup`` asks of a person is done here: a payload is bolted on, drives are left off. The arm may hide what the rig's
own model does not know; its servos do not know it either: a controller is tuned once, for the arm as its maker knew it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm, read_model
from arm_model.effects import check_terms, described
from arm_model.inertia import about_com, barycentric
from arm_model.kinematics import link_frames
from arm_model.servo import fixed_gains
from arm_model.simulation import Stepper, references
from experiment import Experiment, demand_of
from experiment.file import Payload
from inputs import InputError
from sim_backend.run import CHUNK_ROWS, Mover, Steps
from sim_backend.stopping import StoppedDemand

Array = NDArray[np.float64]

ROWS_PER_TICK = 4
"""Rows of the motion in one servo period."""
STANDING_STEP_NS = 218_750


class Standing:
    """sim_backend.run.Mover: brakes on, no current."""

    step_ns = STANDING_STEP_NS
    still_from = 0.0
    current_lag = math.inf

    def __init__(self, pose: Array, gear: Array) -> None:
        self._steps = _still(pose, gear * pose)

    def advance(self) -> Steps:
        return self._steps

    def state(self) -> object:
        return None

    def restore(self, state: object) -> None: ...

    def stop(self, at: float) -> float:
        return at


class Servoed:
    """sim_backend.run.Mover: follows a demand under the arm's servos until the brakes come on, ``hold`` s after its end.

    Brakes come on between two chunks, at or after ``still_from``.
    """

    def __init__(self, arm: Arm, experiment: Experiment, hold: float) -> None:
        self._arm, self._hold = arm, hold
        self._deceleration = np.array(experiment.full_acceleration)
        self._asked = demand_of(experiment)
        self._demand: Callable[[Array], Array] = self._asked
        self._stepper = Stepper(arm, np.array(experiment.start))
        self._gear = arm.joint_array("gear")
        self._last: Steps | None = None
        self.step_ns = round(self._stepper.period * 1e9 / ROWS_PER_TICK)
        self.still_from = self._asked.duration + hold
        assert arm.controller is not None
        self.current_lag = arm.controller.current_lag

    def advance(self) -> Steps:
        first, ticks = self._stepper.tick, CHUNK_ROWS // ROWS_PER_TICK
        if self._last is not None and first * self._stepper.period >= self.still_from:
            return _still(self._last.q[-1], self._last.motor[-1])
        demands = references(self._arm, self._demand, first, ticks)
        rows = np.arange(first * ROWS_PER_TICK, first * ROWS_PER_TICK + CHUNK_ROWS, dtype=np.float64)
        times = rows * (self._stepper.period / ROWS_PER_TICK)
        motion = self._stepper.advance(demands, times)
        self._last = Steps(
            q=motion.q,
            qd=motion.qd,
            motor=self._gear * motion.qm,
            motor_rate=self._gear * motion.qmd,
            current=np.sign(self._gear) * motion.current,
        )
        return self._last

    def state(self) -> object:
        return self._stepper.copy(), self._last

    def restore(self, state: object) -> None:
        assert isinstance(state, tuple)
        self._stepper, self._last = state

    def stop(self, at: float) -> float:
        """From the next setpoint on: the one under way has been sent."""
        assert self._arm.controller is not None
        period = self._arm.controller.setpoint_period
        begin = math.ceil(at / period - 1e-9) * period
        stopped = StoppedDemand(self._asked, begin, self._deceleration)
        self._demand, self.still_from = stopped, min(self.still_from, stopped.duration + self._hold)
        return begin


class SimulatedArm:
    """sim_backend.world.Plant."""

    def __init__(self, arm: Arm, hold: float) -> None:
        self.arm, self._hold = arm, hold
        self.encoder_lines = arm.joint_array("encoder_lines")
        self.rest = np.zeros(len(arm))
        self._gear = arm.joint_array("gear")
        self._described = described(arm)

    def standing(self, pose: Array) -> Mover:
        return Standing(pose, self._gear)

    def loadable(self, experiment: Experiment) -> str:
        if len(experiment.start) != len(self.arm):
            return f"is for {len(experiment.start)} joints, the arm has {len(self.arm)}"
        demand = demand_of(experiment)
        asked = demand(np.arange(0.0, demand.duration + 1e-3, 1e-3))
        for number, (joint, low, high) in enumerate(zip(self.arm.joints, asked.min(axis=0), asked.max(axis=0)), 1):
            if joint.limits is not None and (low < joint.limits[0] - 1e-9 or high > joint.limits[1] + 1e-9):
                return (
                    f"joint {number} is asked to go from {low:.4g} to {high:.4g}; "
                    f"its stops are at {joint.limits[0]:g} and {joint.limits[1]:g}"
                )
        return ""

    def moving(self, experiment: Experiment) -> Mover:
        if experiment.setup.drives_off:
            return Standing(np.array(experiment.start), self._gear)
        arm = self.arm if experiment.setup.payload is None else with_payload(self.arm, experiment.setup.payload)
        return Servoed(arm, experiment, self._hold)

    def target(self, position: Array, point: tuple[float, float, float]) -> Array:
        pose = link_frames(self._described, position)[:, -1]
        return np.asarray(pose[:, :3, :3] @ np.array(point) + pose[:, :3, 3])


def read_arm(path: Path, known: Path | None, hold: float) -> SimulatedArm:
    """The arm in a model file, with the servos that the model ``known`` (None: itself) asks for; ``hold``: see ``Servoed``.

    InputError where it cannot be moved.
    """
    arm = read_model(path)
    check_terms(arm, path)
    if arm.controller is None:
        raise InputError(path, "has no [controller]; an arm that is to move wants one")
    for number, joint in enumerate(arm.joints, 1):
        if joint.encoder_lines is None:
            raise InputError(path, f"joint[{number}].encoder_lines: is missing; the simulated encoder wants it")
    tuned = fixed_gains(arm if known is None or arm.controller.kind != "bandwidth" else read_model(known))
    if len(tuned) != len(arm):
        raise InputError(path, f"has {len(arm)} joints; the rig's own model, {known}, has {len(tuned)}")
    return SimulatedArm(replace(arm, controller=tuned.controller), hold)


def with_payload(arm: Arm, payload: Payload) -> Arm:
    """The arm with a point mass bolted to its last link."""
    last = arm.joints[-1]
    together = barycentric(last.mass, last.com, last.inertia) + barycentric(payload.mass, payload.com, (0.0,) * 6)
    mass, com, (xx, yy, zz, xy, yz, xz) = about_com(together)
    loaded = replace(last, mass=mass, com=com, inertia=(xx, yy, zz, xy, yz, xz))
    return replace(arm, joints=(*arm.joints[:-1], loaded))


def _still(q: Array, motor: Array) -> Steps:
    """A chunk in which nothing moves and no current flows."""
    rows = (CHUNK_ROWS, 1)
    nothing = np.zeros((CHUNK_ROWS, len(q)))
    return Steps(np.tile(q, rows), nothing, np.tile(motor, rows), nothing, nothing)
