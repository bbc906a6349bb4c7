"""The arm of a simulated rig: ``arm_model``'s computed dynamics under its servos, as the plant of a ``World``.

What an experiment's ``setup`` asks of a person is done here: a payload is bolted on, drives are left off. The arm may
hide what the rig's own model does not know; its servos do not know it either: a controller is tuned once, for the arm
as its maker knew it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, on_fixed_base, read_model
from arm_model.effects import check_terms
from arm_model.rigid_body.inertia import about_com, barycentric
from arm_model.servo import fixed_gains
from arm_model.tracking import latency, target_at
from experiment import Experiment, Payload, demand_of, excesses
from sim_backend.arm.arm_motion import Instruments, Servoed, Standing
from sim_backend.arm.signals import Mover

FREE, ROUNDING = 1e15, 1e-9
"""rad (m): no stop, and by how much a position may be beyond one."""


class SimulatedArm:
    """sim_backend.rig.world.Plant."""

    def __init__(self, arm: Arm, hold: float) -> None:
        self.arm, self._hold = arm, hold
        self.encoder_lines = arm.joint_array("encoder_lines")
        self.rest = np.zeros(len(arm))
        self.tracker_latency = latency(arm)

    def standing(self, pose: Array) -> Mover:
        return Standing(self.arm, pose, pose)

    def loadable(self, experiment: Experiment) -> str:
        if len(experiment.start) != len(self.arm):
            return f"is for {len(experiment.start)} joints, the arm has {len(self.arm)}"
        stops = [joint.limits or (-FREE, FREE) for joint in self.arm.joints]
        low, high = np.array(stops).T
        for beyond in excesses(demand_of(experiment), low=low - ROUNDING, high=high + ROUNDING):
            first, last = stops[beyond.joint - 1]
            return (
                f"the motion takes joint {beyond.joint} to {beyond.value:.4g}; its stops are at {first:g} and {last:g}"
            )
        return ""

    def moving(self, experiment: Experiment) -> Mover:
        if experiment.setup.drives_off:
            return Standing(self.arm, np.array(experiment.start), np.array(experiment.start))
        arm = self.arm if experiment.setup.payload is None else with_payload(self.arm, experiment.setup.payload)
        return Servoed(arm, experiment, self._hold)

    def target(self, position: Array, point: tuple[float, float, float]) -> Array:
        return target_at(self.arm, position, point)


def read_arm(path: Path, known: Path | None, hold: float) -> SimulatedArm:
    """The arm in a model file, with the servos that the model ``known`` asks for.

    Where ``known`` is None or has no controller, as a URDF file has none, the servos are those of the file itself.

    ``hold``: see ``Servoed``.

    InputError where it cannot be moved.
    """
    arm = on_fixed_base(read_model(path), path, "a simulated rig")
    check_terms(arm, path)
    Instruments(arm)  # refuses what cannot be simulated
    if arm.controller is None:
        raise InputError(path, "has no [controller]; an arm that is to move needs one")
    for number, joint in enumerate(arm.joints, 1):
        if joint.encoder_lines is None:
            raise InputError(path, f"joint[{number}].encoder_lines: is missing; the simulated encoder needs it")
    tuned = arm
    if known is not None and arm.controller.kind == "bandwidth":
        nominal = read_model(known)
        if len(nominal) != len(arm):
            raise InputError(path, f"has {len(arm)} joints; the rig's own model, {known}, has {len(nominal)}")
        if nominal.controller is not None:
            tuned = nominal
    return SimulatedArm(replace(arm, controller=fixed_gains(tuned).controller), hold)


def with_payload(arm: Arm, payload: Payload) -> Arm:
    """The arm with a point mass bolted to its last link."""
    last = arm.joints[-1]
    together = barycentric(last.mass, last.com, last.inertia) + barycentric(payload.mass, payload.com, payload.inertia)
    mass, com, (xx, yy, zz, xy, yz, xz) = about_com(together)
    loaded = replace(last, mass=mass, com=com, inertia=(xx, yy, zz, xy, yz, xz))
    return replace(arm, joints=(*arm.joints[:-1], loaded))
