"""Twelve arms that are not the Puma, by published or typical figures: ``arms.csv``, a row per joint.

Drive figures are at the joint (N m, N m s/rad, kg m2; of a prismatic joint N, N s/m, kg), except ``gear`` and
``torque_constant``, which are the motor's. Coupled arms report drive angles; ``coupling`` maps them to joint angles.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Triple = tuple[float, float, float]

TABLE = Path(__file__).parent / "arms.csv"
AXES: dict[str, Triple] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
COUPLING = {"palletiser": ((3, 2, -1.0), (4, 3, -1.0))}
"""Of the arms that have one, see ``ForeignArm.coupling``."""


@dataclass(frozen=True)
class Joint:
    """One joint with its drive and the link that it moves; frames as URDF has them.

    inertia   (xx, yy, zz) about the centre of mass
    rotor     inertia of the rotor at the joint
    reach     the range of the motions; speed: their largest
    rated     torque or force that the drive is built for
    step      of the encoder, at the joint
    loaded    whether gravity's torque on it changes with the pose
    """

    xyz: Triple
    axis: Triple
    mass: float
    com: Triple
    inertia: Triple
    rotor: float
    coulomb: float
    viscous: float
    rated: float
    reach: tuple[float, float]
    speed: float
    rpy: Triple
    gear: float
    torque_constant: float
    step: float
    loaded: bool
    prismatic: bool


@dataclass(frozen=True)
class ForeignArm:
    """coupling: (joint, by, ratio): the angle of a joint has ``ratio`` times the reported angle of another in it."""

    name: str
    joints: tuple[Joint, ...]
    coupling: tuple[tuple[int, int, float], ...] = ()

    @property
    def to_joints(self) -> np.ndarray:
        """(n, n): joint angles are this matrix times reported angles."""
        matrix = np.eye(len(self.joints))
        for joint, by, ratio in self.coupling:
            matrix[joint - 1, by - 1] = ratio
        return matrix


def _read() -> dict[str, ForeignArm]:
    joints: dict[str, list[Joint]] = {}
    with TABLE.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file, skipinitialspace=True):
            joints.setdefault(row.pop("arm").strip(), []).append(_joint(row))
    return {name: ForeignArm(name, tuple(of), COUPLING.get(name, ())) for name, of in joints.items()}


def _joint(row: dict[str, str]) -> Joint:
    def triple(*columns: str) -> Triple:
        x, y, z = (float(row[column]) for column in columns)
        return x, y, z

    same = ("mass", "rotor", "coulomb", "viscous", "rated", "speed", "gear", "torque_constant", "step")
    return Joint(
        xyz=triple("x", "y", "z"),
        rpy=triple("roll", "pitch", "yaw"),
        axis=AXES[row["axis"]],
        com=triple("com_x", "com_y", "com_z"),
        inertia=triple("ixx", "iyy", "izz"),
        reach=(float(row["low"]), float(row["high"])),
        loaded=row["loaded"] == "yes",
        prismatic=row["kind"] == "prismatic",
        **{name: float(row[name]) for name in same},
    )


ARMS = _read()
