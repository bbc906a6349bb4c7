"""Random arms as strangers bring them, as model files or URDF.

1 to 8 joints, revolute and prismatic, placed by D-H parameters (standard, modified) or as in URDF; massless links,
links without inertia about their axis, masses from grams to tonnes, drives without rotors, gears, friction or limits.
What a stranger's file leaves out is left out more often than not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm_model import Arm, write_model
from arm_model.description import Controller, Joint
from arm_model.rigid_body.kinematics import roll_pitch_yaw
from arm_model.servo import fixed_gains
from arm_model.urdf import write_urdf

Generator = np.random.Generator
TURNS = (0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi, 0.3)
"""rad: angles between the axes of arms."""


@dataclass(frozen=True)
class Stranger:
    """An arm as its file describes it, and the real one, which has a controller, friction and a load that it lacks."""

    model: Arm
    real: Arm
    urdf: bool

    def write(self, folder: Path) -> tuple[Path, Path]:
        """The model's file (URDF has no drives: the file says less than ``model``) and the real arm's."""
        model, real = folder / ("arm.urdf" if self.urdf else "arm.toml"), folder / "real.toml"
        (write_urdf if self.urdf else write_model)(model, self.model)
        write_model(real, self.real)
        return model, real


def stranger(seed: int) -> Stranger:
    """The same arm for the same seed."""
    rng = np.random.default_rng(seed)
    count, size = int(rng.integers(1, 9)), float(10 ** rng.choice([-2.0, 0.0, 0.0, 0.0, 2.0]))
    every, urdf = str(rng.choice(["standard", "modified", "placed", "mixed"])), bool(rng.random() < 0.4)
    base = roll_pitch_yaw(tuple(rng.normal(size=3) * rng.integers(2)))
    base[:3, 3] = rng.normal(size=3) * rng.integers(2)
    joints = tuple(_joint(rng, every, size) for _ in range(count))
    arm = Arm(
        name=f"random {seed}",
        joints=joints,
        gravity=(0.0, 0.0, 0.0) if rng.random() < 0.1 else (0.0, 0.0, -9.81),
        base=tuple(tuple(map(float, row)) for row in base),
    )
    if rng.random() < 0.5:
        arm = replace(arm, controller=_controller(rng, count))
    return Stranger(arm, _real(rng, arm), urdf)


def _joint(rng: Generator, every: str, size: float) -> Joint:
    kind = str(rng.choice(["revolute", "revolute", "revolute", "prismatic"]))
    convention = str(rng.choice(["standard", "modified", "placed"])) if every == "mixed" else every
    return Joint(type=kind, convention=convention, **_place(rng, convention), **_link(rng, size), **_drive(rng, size))


def _place(rng: Generator, convention: str) -> dict[str, Any]:
    if convention == "placed":
        axis = rng.normal(size=3) if rng.random() < 0.3 else np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        return {
            "xyz": tuple(map(float, rng.normal(size=3) * 0.3)),
            "rpy": tuple(map(float, rng.choice(TURNS, size=3))),
            "axis": tuple(map(float, axis)),
        }
    return {
        "theta": float(rng.choice(TURNS)),
        "d": float(rng.choice([0.0, 0.2])),
        "a": float(rng.choice([0.0, 0.4])),
        "alpha": float(rng.choice(TURNS)),
        "beta": float(rng.choice([0.0, 0.0, 0.01])),
    }


def _link(rng: Generator, size: float) -> dict[str, Any]:
    """Mass, com and inertia of a few points; massless, a point, or a rod along an axis of its frame now and then."""
    form = rng.choice(["body", "body", "body", "massless", "point", "rod"])
    if form == "massless":
        return {}
    points, weights = rng.normal(size=(6, 3)) * 0.1, rng.uniform(0.1, 1.0, size=6) * size
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


def _drive(rng: Generator, size: float) -> dict[str, Any]:
    gear = float(rng.choice([1.0, 1.0, 50.0, -100.0]))
    drive: dict[str, Any] = {"gear": gear, "torque_constant": float(rng.choice([1.0, 0.1]))}
    if rng.random() < 0.4:
        drive["rotor_inertia"] = 0.1 * size / gear**2
    if rng.random() < 0.5:
        drive["viscous"] = tuple(size * rng.uniform(0.2, 1.0, size=2) / gear**2)
        drive["coulomb"] = tuple(size * rng.uniform(0.2, 1.0, size=2) / abs(gear))
    if rng.random() < 0.5:
        drive["limits"] = (-float(rng.uniform(0.1, 3.0)), float(rng.uniform(0.1, 3.0)))
    if rng.random() < 0.3:
        drive["motor_speed_limit"] = float(rng.uniform(0.5, 3.0)) * abs(gear)
    if rng.random() < 0.3:
        drive["torque_limit"] = 300.0 * size
    if rng.random() < 0.3:
        drive["encoder_lines"] = 1000
    return drive


def _controller(rng: Generator, count: int) -> Controller:
    kind, period = str(rng.choice(["bandwidth", "cascade", "gains"])), float(rng.choice([0.004, 0.008]))
    if kind == "bandwidth":
        how: dict[str, Any] = {"natural_frequency": (20.0,) * count, "inertia_pose": (0.0,) * count}
    elif kind == "cascade":
        how = {"position_gain": (20.0,) * count, "velocity_gain": (50.0,) * count}
    else:
        how = {"position_gain": (400.0,) * count, "velocity_gain": (40.0,) * count}
    return Controller(kind=kind, setpoint_period=period, servo_period=0.002, **how)


def _real(rng: Generator, arm: Arm) -> Arm:
    """The arm of which a recording is made: rotors, friction and a load as large as it takes to be simulated well."""
    size = sum(joint.mass for joint in arm.joints) or 1.0
    joints = []
    for joint in arm.joints:
        rotor = joint.rotor_inertia + 0.5 * size / joint.ratio**2
        rubbing = tuple(one or 0.2 * size / joint.ratio for one in joint.coulomb)
        viscous = tuple(one or 0.2 * size / joint.ratio**2 for one in joint.viscous)
        joints.append(replace(joint, rotor_inertia=rotor, coulomb=rubbing, viscous=viscous, torque_limit=None))
    count = len(arm)
    controller = Controller(
        setpoint_period=0.004,
        servo_period=0.002,
        natural_frequency=(20.0,) * count,
        inertia_pose=(0.0,) * count,
        integral_rate=5.0,
    )
    real = fixed_gains(replace(arm, joints=tuple(joints), controller=controller))
    changes = [
        lambda one: one.with_effect("payload", mass=0.1 * size, x=0.05, y=0.0, z=0.1),
        lambda one: one.with_effect("joint_zero_offset", int(rng.integers(1, count + 1)), offset=0.03),
        lambda one: one,
    ]
    return changes[rng.integers(len(changes))](real)
