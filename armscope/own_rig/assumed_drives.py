"""Drives for an arm whose file says nothing of them (URDF, MuJoCo), so that it can be simulated: sized, not measured.

Each value is derived from the arm's own masses and limits, is what a designer would choose to two digits, and is named
in a sentence. What the file says is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, Controller, Joint
from arm_model.rigid_body import drive_mass_matrix, nearest_line, regeared
from arm_model.system import inverse_dynamics
from arm_report.numbers import numbered

POSES = 64
"""Random poses within the limits at which weight and inertia of a joint are looked at."""
TURNING, SLIDING = 2.0, 0.5
"""rad/s, m/s: speed of a joint whose file states none."""
TURN, SLIDE = np.pi, 0.2
"""rad, m: how far a joint without limits goes to either side."""
MOTOR_SPEED, CURRENT = 300.0, 5.0
"""rad/s and A of a motor at its limits, as servo motors of arms have them."""
RISE = 4.0
"""1/s: acceleration over speed limit; an arm that reaches its speed in a quarter of a second."""
RESERVE = 2.0
"""Torque limit over what weight, acceleration and the friction of the file need."""
ROTOR, SPIN_UP = 0.3, 0.01
"""Of a rotor: its share of the inertia at the joint, and s in which the torque limit brings it to full speed, at least:
a motor of that torque is no lighter."""
FRICTION = 0.04
"""Coulomb friction, and viscous friction at full speed, over the torque limit."""
ENCODER_LINES = 1000


@dataclass(frozen=True)
class Sized:
    """A joint with what was assumed of it, a phrase each; none where its file says all."""

    joint: Joint
    assumed: list[str]


@dataclass(frozen=True)
class _Load:
    """``weight`` N m (N): the largest on a joint; ``inertia`` kg m2 (kg): the largest that it moves."""

    weight: float
    inertia: float


def with_drives(arm: Arm, *, torques: bool = False) -> tuple[Arm, list[str]]:
    """The arm with drives, limits and a controller; and sentences that say what was assumed, of whom.

    torques  True: the drives report torques at the joint, N m (N); nothing is assumed of their motors
    InputError for a joint that moves nothing.
    """
    weights, inertias = _loads(arm)
    sized = [
        _sized(joint, f"joint[{number}]", _Load(weight, inertia), torques=torques)
        for number, (joint, weight, inertia) in enumerate(zip(arm.joints, weights.tolist(), inertias.tolist()), 1)
    ]
    driven = replace(arm, joints=tuple(one.joint for one in sized))
    assumed = _sentences(arm, [one.assumed for one in sized])
    if arm.controller is None:
        driven = replace(driven, controller=_controller(driven))
        assumed.append("controller: a servo of 40 rad/s per joint, setpoints every 20 ms")
    return driven, assumed


def _sentences(arm: Arm, assumed: Sequence[Sequence[str]]) -> list[str]:
    """What was assumed of all joints alike; then of each, those of whom the same was assumed together."""
    shared = [phrase for phrase in assumed[0] if len(arm) > 1 and all(phrase in own for own in assumed)]
    joints_of: dict[str, list[str]] = {}
    for number, (joint, own) in enumerate(zip(arm.joints, assumed), 1):
        name = f"{number} ({joint.name})" if joint.name else f"{number}"
        joints_of.setdefault(", ".join(phrase for phrase in own if phrase not in shared), []).append(name)
    of_each = [f"{numbered('joint', names)}: {own}" for own, names in joints_of.items() if own]
    return [f"all joints: {', '.join(shared)}", *of_each] if shared else of_each


def ranges(arm: Arm) -> Array:
    """(n, 2) rad (m): the limits of the joints, and half a turn or 0.2 m to either side where there are none."""
    free = {True: (-TURN, TURN), False: (-SLIDE, SLIDE)}
    return np.array([joint.limits or free[joint.revolute] for joint in arm.joints])


def _loads(arm: Arm) -> tuple[Array, Array]:
    """(n,) N m (N): the largest weight on each joint, and (n,) kg m2 (kg) the largest inertia of its links."""
    low, high = ranges(arm).T
    middle, half = (low + high) / 2, np.minimum((high - low) / 2, TURN)
    poses = middle + half * np.random.default_rng(1).uniform(-1.0, 1.0, (POSES, len(arm)))
    still = np.zeros_like(poses)
    weight = np.abs(inverse_dynamics(arm, poses, still, still)).max(axis=0)
    return weight, np.diagonal(drive_mass_matrix(arm, poses), axis1=1, axis2=2).max(axis=0)


def _sized(joint: Joint, place: str, load: _Load, *, torques: bool) -> Sized:
    weight, inertia = load.weight, load.inertia
    if not inertia > 0:
        raise InputError(place, "moves no mass; to be simulated, a joint must move some")
    assumed: list[str] = []
    without = joint.encoder_lines is None and abs(joint.drive_constant - 1.0) < 1e-9
    speed = (joint.motor_speed_limit or 0.0) / joint.ratio
    angle, torque = ("rad", "N m") if joint.revolute else ("m", "N")
    if not speed:
        speed = TURNING if joint.revolute else SLIDING
        assumed.append(f"speed limit {speed:g} {angle}/s")
    coulomb, viscous, _ = nearest_line(joint)
    least = weight + coulomb
    needed = least + viscous * speed + inertia * RISE * speed
    limit = joint.torque_limit or 0.0
    if limit <= 1.1 * least or not limit:
        if limit:
            assumed.append(
                f"{limit:g} {torque} of the file cannot move it against {least:.3g} {torque} of weight and friction"
            )
        limit = _round(RESERVE * needed)
        assumed.append(f"{'torque' if joint.revolute else 'force'} limit {limit:g} {torque}")
    if without and joint.gear == 1.0 and not torques:
        joint = regeared(joint, _round(MOTOR_SPEED / speed))
        assumed.append(f"gear {joint.gear:g}{'' if joint.revolute else ' rad/m'}")
    ratio = joint.ratio
    changes: dict[str, object] = {"torque_limit": limit, "motor_speed_limit": ratio * speed}
    if without and not torques:
        changes["torque_constant"] = _round(limit / ratio / CURRENT)
        assumed.append(f"{changes['torque_constant']:g} N m/A at the motor")
    if not joint.rotor_inertia:
        changes["rotor_inertia"] = _round(max(ROTOR * inertia, SPIN_UP * limit / speed) / ratio**2)
        assumed.append(f"rotor inertia {changes['rotor_inertia']:g} kg m2")
    if joint.coulomb == (0.0, 0.0) and joint.viscous == (0.0, 0.0) and joint.friction_curve is None:
        coulomb, viscous = _round(FRICTION * limit / ratio), _round(FRICTION * limit / speed / ratio**2)
        changes |= {"coulomb": (coulomb, coulomb), "viscous": (viscous, viscous)}
        assumed.append(f"friction {coulomb:g} N m and {viscous:g} N m s/rad at the motor")
    if not joint.revolute and joint.sign_velocity == Joint().sign_velocity:
        changes["sign_velocity"] = joint.sign_velocity * SLIDING / TURNING
    if joint.encoder_lines is None:
        changes["encoder_lines"] = ENCODER_LINES
        assumed.append(f"an encoder of {ENCODER_LINES} lines")
    return Sized(replace(joint, **changes), assumed)  # type: ignore[arg-type]


def _controller(arm: Arm) -> Controller:
    middle = ranges(arm).mean(axis=1)
    return Controller(
        setpoint_period=0.02,
        servo_period=0.001,
        natural_frequency=(40.0,) * len(arm),
        integral_rate=1.5,
        inertia_pose=tuple(float(value) for value in middle),
        velocity_bandwidth=500.0,
        current_lag=0.0004,
    )


def _round(value: float) -> float:
    return float(f"{value:.2g}")
