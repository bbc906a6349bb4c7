"""Gains of the independent-joint servos (``arm_model.description.Controller``)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.moving_base.numeric import mass_matrix_with_base
from arm_model.rigid_body.numeric import drive_mass_matrix
from arm_model.tables.floating_base import Six


@dataclass(frozen=True)
class Gains:
    """(n,) each: A/rad, A/(rad s), A s/rad of the joint angle (V and m where the controller has them)."""

    position: Array
    integral: Array
    velocity: Array


def servo_gains(arm: Arm) -> Gains:
    """The gains in force; InputError where the arm has no controller."""
    controller = arm.controller
    if controller is None:
        raise InputError(arm.name, "the model has no [controller]; simulating demanded positions needs one")
    zeros = np.zeros(len(arm))
    if controller.kind == "bandwidth":
        rotors = np.array(_at_pose(_Rigid((arm.base, arm.joints, arm.coupling, controller.inertia_pose), arm)))
        inertia = rotors / arm.joint_array("drive_constant")
        pulsation = np.array(controller.natural_frequency, float)
        position = pulsation**2 * inertia
        return Gains(position, controller.integral_rate * position, 2 * controller.damping_ratio * pulsation * inertia)
    position, velocity = np.array(controller.position_gain), np.array(controller.velocity_gain)
    integral = zeros if controller.integral_gain is None else np.array(controller.integral_gain)
    if controller.kind == "cascade":
        return Gains(position * velocity, integral, velocity)
    return Gains(position, integral, velocity)


@dataclass(frozen=True)
class _Rigid:
    """An arm, equal to any other with the same mass matrix at the same pose: ``key`` has what these depend on."""

    key: tuple[object, ...]
    arm: Arm = field(compare=False)


@lru_cache(maxsize=64)  # every simulation asks for it
def _at_pose(rigid: _Rigid) -> tuple[float, ...]:
    """(n,) diagonal of the mass matrix at the drives, at the pose of the controller."""
    pose = np.array(rigid.key[-1], float)
    return tuple(np.diag(drive_mass_matrix(rigid.arm, pose)[0]).tolist())


def station_inertia(arm: Arm) -> Six:
    """kg, kg m2: M of the base's ``StationKeeping``, as it stands there or of the model with its joints at zero."""
    station = None if arm.floating is None else arm.floating.controller
    if station is not None and station.inertia is not None:
        return station.inertia
    diagonal = np.diag(mass_matrix_with_base(arm, np.zeros((1, len(arm))))[0])
    surge, sway, heave, roll, pitch, yaw = map(float, diagonal[:6])
    return surge, sway, heave, roll, pitch, yaw


def fixed_gains(arm: Arm) -> Arm:
    """The arm with its controllers' gains as numbers, so that they outlive a change of its masses."""
    if arm.floating is not None and arm.floating.controller is not None:
        station = replace(arm.floating.controller, inertia=station_inertia(arm))
        arm = replace(arm, floating=replace(arm.floating, controller=station))
    if arm.controller is None or arm.controller.kind != "bandwidth":
        return arm
    gains = servo_gains(arm)
    controller = replace(
        arm.controller,
        kind="gains",
        natural_frequency=None,
        inertia_pose=None,
        integral_rate=0.0,
        position_gain=tuple(map(float, gains.position)),
        velocity_gain=tuple(map(float, gains.velocity)),
        integral_gain=tuple(map(float, gains.integral)),
    )
    return replace(arm, controller=controller)
