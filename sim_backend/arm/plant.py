"""The arm of a simulated rig: ``arm_model``'s computed dynamics under its servos, as the plant of a ``World``.

What an experiment's ``setup`` asks of a person is done here: a payload is bolted on, drives are left off. The arm may
hide what the rig's own model does not know; its servos do not know it either: a controller is tuned once, for the arm
as its maker knew it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from arm_io import InputError, counted
from arm_io.toml import one_line
from arm_io.types import Array
from arm_model import Arm, Controller, Joint, read_model
from arm_model.effects import check_terms
from arm_model.rigid_body import regeared
from arm_model.rigid_body.inertia import about_com, barycentric
from arm_model.servo import fixed_gains
from arm_model.tracking import latency, target_at
from experiment import Experiment, Payload, demand_of, excesses
from sim_backend.arm.arm_motion import Instruments, Servoed, Standing
from sim_backend.arm.signals import Mover
from sim_backend.arm.vehicle import ThrusterSines, ThrusterTable

FREE, ROUNDING = 1e15, 1e-9
"""rad (m): no stop, and by how much a position may be beyond one."""
COUNTS_PER_LINE = 4
"""Edges of a line and its quadrature."""


class SimulatedArm:
    """sim_backend.rig.world.Plant."""

    def __init__(self, arm: Arm, encoder_lines: Array, hold: float) -> None:
        self.arm, self._hold, self.encoder_lines = arm, hold, encoder_lines
        self.rest = np.zeros(len(arm))
        self.tracker_latency = latency(arm)
        self.thrusters = None if arm.floating is None else arm.thrusters
        self._driven: tuple[ThrusterTable, int] | None = None

    def excite(self, table: ThrusterTable, seed: int) -> None:
        """What the thrusters of a floating base are asked for, beside keeping station, while an experiment lasts."""
        self._driven = (table, seed)

    def standing(self, pose: Array) -> Mover:
        return Standing(self.arm, pose, pose)

    def loadable(self, experiment: Experiment) -> str:
        if len(experiment.start) != len(self.arm):
            return f"is for {counted(len(experiment.start), 'joint')}, the arm has {len(self.arm)}"
        stops = [joint.limits or (-FREE, FREE) for joint in self.arm.joints]
        low, high = np.array(stops).T
        for beyond in excesses(demand_of(experiment), low=low - ROUNDING, high=high + ROUNDING):
            first, last = stops[beyond.joint - 1]
            unit = "rad" if self.arm.joints[beyond.joint - 1].revolute else "m"
            return (
                f"the motion takes joint {beyond.joint} to {beyond.value:.4g} {unit}; its stops are at {first:g} and "
                f"{last:g} {unit}"
            )
        return ""

    def moving(self, experiment: Experiment) -> Mover:
        if experiment.setup.drives_off:
            return Standing(self.arm, np.array(experiment.start), np.array(experiment.start))
        arm = self.arm if experiment.setup.payload is None else with_payload(self.arm, experiment.setup.payload)
        sines = None
        if self._driven is not None and self.thrusters:
            table, seed = self._driven
            sines = ThrusterSines(table, self.thrusters, seed, experiment.name)
        return Servoed(arm, experiment, self._hold, sines)

    def target(self, position: Array, point: tuple[float, float, float]) -> Array:
        return target_at(self.arm, position, point)


@dataclass(frozen=True)
class Drives:
    """What a rig file says of the drives: for models that say nothing of them, as URDF files.

    gears       (n,) motor angle over joint position, with its sign
    counts      (n,) x4 counts per rad (m) of the joint, with the sign; None where the rig has no encoder
    controller  the servos; None: the rig file has none
    rotors      (n,) kg m2 at the motors; empty: the rig file has none
    """

    gears: tuple[float, ...] = ()
    counts: tuple[float | None, ...] = ()
    controller: Controller | None = None
    rotors: tuple[float, ...] = ()


def read_arm(path: Path, known: Path | None, drives: Drives, hold: float) -> SimulatedArm:
    """The arm in a model file, with the servos of the rig file, else of the model ``known``.

    Where ``known`` is None or has no controller, as a URDF file has none, the servos are those of the file itself. A
    joint without encoder lines is given the gear and the encoder of the rig file, one without a rotor that of the rig
    file. ``hold``: see ``Servoed``.

    InputError where it cannot be moved.
    """
    arm = read_model(path)
    check_terms(arm, path)
    Instruments(arm)  # refuses what cannot be simulated
    tuned = arm
    if known is not None and (drives.controller or arm.controller is None or arm.controller.kind == "bandwidth"):
        nominal = read_model(known)
        if len(nominal) != len(arm):
            raise InputError(
                path, f"has {counted(len(arm), 'joint')}; the rig's own model, {known}, has {len(nominal)}"
            )
        if drives.controller or nominal.controller is not None:
            tuned = nominal
    if drives.controller is not None:
        tuned = _with_controller(tuned, drives.controller)
    if tuned.controller is None:
        raise InputError(
            path,
            "has no [controller]; an arm that is to move needs one, here or as [simulation.controller] of the rig file",
        )
    if drives.rotors and len(drives.rotors) != len(arm):
        raise InputError(
            "simulation", f"rotor_inertia: has {len(drives.rotors)} entries for {counted(len(arm), 'joint')}"
        )
    joints, lines = zip(*(_with_encoder(joint, j, drives, path) for j, joint in enumerate(arm.joints)))
    servos = fixed_gains(_with_rotors(tuned, drives)).controller
    moving = _with_rotors(replace(arm, joints=joints, controller=servos), drives)
    return SimulatedArm(moving, np.array(lines, float), hold)


def _with_controller(arm: Arm, controller: Controller) -> Arm:
    try:
        return replace(arm, controller=controller)
    except ValidationError as error:
        raise InputError("simulation.controller", one_line(error)) from None


def _with_rotors(arm: Arm, drives: Drives) -> Arm:
    """Joints without a rotor get that of the rig file."""
    rotors = drives.rotors or (0.0,) * len(arm)
    joints = tuple(
        joint if joint.rotor_inertia else replace(joint, rotor_inertia=rotor)
        for joint, rotor in zip(arm.joints, rotors)
    )
    return replace(arm, joints=joints)


def _with_encoder(joint: Joint, j: int, drives: Drives, path: Path) -> tuple[Joint, float]:
    """Joint j and the lines of its encoder per motor revolution: of the model, else of the rig file, with its gear."""
    if joint.encoder_lines is not None:
        return joint, joint.encoder_lines
    counts = drives.counts[j] if j < len(drives.counts) else None
    if counts is None:
        raise InputError(
            path,
            f"joint[{j + 1}].encoder_lines: is missing; the simulated encoder needs it, or the rig file's encoder of "
            "this joint",
        )
    joint = regeared(joint, drives.gears[j])
    return joint, counts / COUNTS_PER_LINE * 2 * np.pi / joint.gear


def with_payload(arm: Arm, payload: Payload) -> Arm:
    """The arm with a point mass bolted to its last link."""
    last = arm.joints[-1]
    together = barycentric(last.mass, last.com, last.inertia) + barycentric(payload.mass, payload.com, payload.inertia)
    mass, com, (xx, yy, zz, xy, yz, xz) = about_com(together)
    loaded = replace(last, mass=mass, com=com, inertia=(xx, yy, zz, xy, yz, xz))
    return replace(arm, joints=(*arm.joints[:-1], loaded))
