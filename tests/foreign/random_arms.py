"""Random arms as strangers bring them, as model files or URDF.

1 to 8 joints (few more often than many, whose commands take ten times as long), revolute and prismatic, placed by D-H
parameters (standard, modified) or as in URDF; massless links, links without inertia about their axis, from a micro arm
of grams to a press of tonnes; drives without rotors, gears, friction or limits, and with gears of 1000; coupled joints,
tools, friction of other shapes. What a stranger's file leaves out is left out more often than not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm_model import Arm, write_model
from arm_model.description import Coupling, Joint
from arm_model.rigid_body.kinematics import roll_pitch_yaw
from arm_model.servo import fixed_gains
from arm_model.tables.controller import Controller
from arm_model.tables.drive import FrictionCurve
from arm_model.tables.link_shapes import Cylinder
from arm_model.urdf import write_urdf
from tests.foreign.dressed import dressed

Generator = np.random.Generator
TURNS = (0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi, 0.3)
"""rad: angles between the axes of arms."""
JOINTS = range(1, 9)
SIZES = (0.01, 0.1, 1.0, 1.0, 1.0, 1.0, 3.0)
"""m: a joint's typical distance from the next, some 0.3 times this; masses go with its third power."""


@dataclass(frozen=True)
class Stranger:
    """An arm as its file describes it, and the real one, which has a controller, friction and a load that it lacks.

    seed: of what its URDF file has that no model has (``dressed``)
    """

    model: Arm
    real: Arm
    urdf: bool
    seed: int

    def write(self, folder: Path) -> tuple[Path, Path]:
        """The model's file (URDF has no drives: the file says less than ``model``) and the real arm's."""
        model, real = folder / ("arm.urdf" if self.urdf else "arm.toml"), folder / "real.toml"
        (write_urdf if self.urdf else write_model)(model, self.model)
        if self.urdf:
            model.write_text(dressed(model.read_text(), np.random.default_rng([self.seed, 2])))
        write_model(real, self.real)
        return model, real


def stranger(seed: int) -> Stranger:
    """The same arm for the same seed."""
    rng = np.random.default_rng(seed)
    chances = 1.0 / np.array(JOINTS)
    count, size = int(rng.choice(JOINTS, p=chances / chances.sum())), float(rng.choice(SIZES))
    every, urdf = str(rng.choice(["standard", "modified", "placed", "mixed"])), bool(rng.random() < 0.4)
    joints = tuple(_joint(rng, every, size) for _ in range(count))
    arm = Arm(
        name=f"random {seed}",
        joints=joints,
        gravity=(0.0, 0.0, 0.0) if rng.random() < 0.1 else (0.0, 0.0, -9.81),
        base=_pose(rng, size),
        tool=_pose(rng, size),
    )
    if rng.random() < 0.5:
        arm = replace(arm, controller=_controller(rng, count))
    if not urdf and count > 1 and rng.random() < 0.15:
        arm = replace(arm, coupling=_coupling(rng, count))
    return _with_real(rng, Stranger(arm, arm, urdf, seed))


def _pose(rng: Generator, size: float) -> Any:
    """Turned and moved somewhere, more often than not nowhere."""
    pose = roll_pitch_yaw(tuple(rng.normal(size=3) * rng.integers(2)))
    pose[:3, 3] = size * rng.normal(size=3) * rng.integers(2)
    return tuple(tuple(map(float, row)) for row in pose)


def _coupling(rng: Generator, count: int) -> tuple[Coupling, ...]:
    """A joint that shows its angle against the base, or a wrist of which one motor turns the next axis."""
    joint = int(rng.integers(2, count + 1))
    return (Coupling(joint, joint - 1, float(rng.choice([-1.0, 1.0, 0.02]))),)


def _joint(rng: Generator, every: str, size: float) -> Joint:
    kind = str(rng.choice(["revolute", "revolute", "revolute", "prismatic"]))
    convention = str(rng.choice(["standard", "modified", "placed"])) if every == "mixed" else every
    travel = size if kind == "prismatic" else 1.0
    drive = _drive(rng, size**3, travel)
    return Joint(type=kind, convention=convention, **_place(rng, convention, size), **_link(rng, size), **drive)


def _place(rng: Generator, convention: str, size: float) -> dict[str, Any]:
    if convention == "placed":
        axis = rng.normal(size=3) if rng.random() < 0.3 else np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        return {
            "xyz": tuple(map(float, rng.normal(size=3) * 0.3 * size)),
            "rpy": tuple(map(float, rng.choice(TURNS, size=3))),
            "axis": tuple(map(float, axis)),
        }
    return {
        "theta": float(rng.choice(TURNS)),
        "d": float(rng.choice([0.0, 0.2]) * size),
        "a": float(rng.choice([0.0, 0.4]) * size),
        "alpha": float(rng.choice(TURNS)),
        "beta": float(rng.choice([0.0, 0.0, 0.01])),
    }


def _link(rng: Generator, size: float) -> dict[str, Any]:
    """Mass, com and inertia of a few points; massless, a point, or a rod along an axis of its frame now and then."""
    form = rng.choice(["body", "body", "body", "massless", "point", "rod"])
    if form == "massless":
        return {}
    points, weights = rng.normal(size=(6, 3)) * 0.1 * size, rng.uniform(0.1, 1.0, size=6) * size**3
    if form == "point":
        points = np.repeat(points[:1] * rng.integers(2), 6, axis=0)
    if form == "rod":
        points[:, rng.permutation(3)[:2]] = 0.0
    com = weights @ points / weights.sum()
    arms = points - com
    second = np.einsum("k,ki,kj->ij", weights, arms, arms)
    inertia = np.trace(second) * np.eye(3) - second
    return {
        "mass": float(weights.sum()),
        "com": tuple(map(float, com)),
        "inertia": tuple(float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))),
    }


def _drive(rng: Generator, size: float, travel: float) -> dict[str, Any]:
    """size: about the torque, N m, that moves the arm; travel: of the joint, rad or m."""
    gear = float(rng.choice([1.0, 1.0, 1.0, 50.0, 50.0, -100.0, 1000.0]))
    drive: dict[str, Any] = {"gear": gear, "torque_constant": float(rng.choice([1.0, 0.1, 1e-3]))}
    if rng.random() < 0.4:
        drive["rotor_inertia"] = 0.1 * size / gear**2
    if rng.random() < 0.5:
        drive["viscous"] = tuple(size * rng.uniform(0.2, 1.0, size=2) / gear**2)
        drive["coulomb"] = tuple(size * rng.uniform(0.2, 1.0, size=2) / abs(gear))
    if rng.random() < 0.5:
        drive["limits"] = (-travel * float(rng.uniform(0.1, 3.0)), travel * float(rng.uniform(0.1, 3.0)))
    if rng.random() < 0.3:
        drive["motor_speed_limit"] = travel * float(rng.uniform(0.5, 3.0)) * abs(gear)
    if rng.random() < 0.3:
        drive["torque_limit"] = 300.0 * size
    if rng.random() < 0.3:
        drive["encoder_lines"] = 1000
    return drive | _seldom(rng, size)


def _seldom(rng: Generator, size: float) -> dict[str, Any]:
    """What a model file may have and few have."""
    level, speed = size * rng.uniform(0.1, 0.5, size=(2, 3)), (0.0, 0.2, 2.0)
    rare: dict[str, Any] = {
        "friction_curve": FrictionCurve(speed, tuple(map(float, level[0])), tuple(map(float, level[1]))),
        "drag": 0.1 * size,
        "link_viscous": 0.1 * size,
        "link_coulomb": 0.1 * size,
        "cylinder": Cylinder((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), 0.05, drag_coefficient=1.0),
        "current_unit": "V",
        "temperature": 30.0,
        "sign_velocity": 0.1,
    }
    return {name: value for name, value in rare.items() if rng.random() < 0.05}


def _controller(rng: Generator, count: int) -> Controller:
    kind, period = str(rng.choice(["bandwidth", "cascade", "gains"])), float(rng.choice([0.004, 0.008]))
    if kind == "bandwidth":
        how: dict[str, Any] = {"natural_frequency": (20.0,) * count, "inertia_pose": (0.0,) * count}
    elif kind == "cascade":
        how = {"position_gain": (20.0,) * count, "velocity_gain": (50.0,) * count}
    else:
        how = {"position_gain": (400.0,) * count, "velocity_gain": (40.0,) * count}
    return Controller(kind=kind, setpoint_period=period, servo_period=0.002, **how)


def _with_real(rng: Generator, one: Stranger) -> Stranger:
    """With the arm of which recordings are made: rotors and friction as large as it takes to be simulated well.

    The model lacks these at all joints, at some or at none; a load or a zero offset it may lack in any case.
    """
    arm, count = one.model, len(one.model)
    size = sum(joint.mass for joint in arm.joints) or 1.0
    whole = tuple(_driven(joint, size) for joint in arm.joints)
    lacking = rng.random(count) < rng.choice([1.0, 0.3, 0.0])
    model = tuple(joint if lacks else full for joint, full, lacks in zip(arm.joints, whole, lacking))
    controller = Controller(
        setpoint_period=0.004,
        servo_period=0.002,
        natural_frequency=(20.0,) * count,
        inertia_pose=(0.0,) * count,
        integral_rate=5.0,
    )
    bare = tuple(replace(joint, torque_limit=None) for joint in whole)
    real = fixed_gains(replace(arm, joints=bare, controller=controller))
    changes = [
        lambda one: one.with_effect("payload", mass=0.1 * size, x=0.05, y=0.0, z=0.1),
        lambda one: one.with_effect("joint_zero_offset", int(rng.integers(1, count + 1)), offset=0.03),
        lambda one: one,
    ]
    return replace(one, model=replace(arm, joints=model), real=changes[rng.integers(len(changes))](real))


def _driven(joint: Joint, size: float) -> Joint:
    """The joint with a rotor, and friction where it has none."""
    rotor = joint.rotor_inertia + 0.5 * size / joint.ratio**2
    rubbing = tuple(one or 0.2 * size / joint.ratio for one in joint.coulomb)
    viscous = tuple(one or 0.2 * size / joint.ratio**2 for one in joint.viscous)
    return replace(joint, rotor_inertia=rotor, coulomb=rubbing, viscous=viscous)
