"""Six arms that are not the Puma, by published or typical figures, and the URDF file that a stranger has of each.

Drive figures are at the joint (N m, N m s/rad, kg m2; of a prismatic joint N, N s/m, kg), except ``gear`` and
``torque_constant``, which are the motor's. Coupled arms report drive angles; ``coupling`` maps them to joint angles.
"""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from dataclasses import dataclass

import numpy as np

Triple = tuple[float, float, float]


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
    rpy: Triple = (0.0, 0.0, 0.0)
    gear: float = 100.0
    torque_constant: float = 0.1
    step: float = 2 * np.pi / 2**17
    loaded: bool = True
    prismatic: bool = False


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


Z, Y = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
_UPRIGHT, _FLAT = (-np.pi / 2, 0.0, 0.0), (np.pi / 2, 0.0, 0.0)

UR = ForeignArm(
    "ur",
    (
        Joint(
            (0, 0, 0.089), Z, 3.7, (0, -0.02, 0), (0.011, 0.011, 0.009), 0.9, 9, 11, 150, (-1.5, 1.5), 1.6, loaded=False
        ),
        Joint((0, 0.136, 0), Y, 8.39, (0, 0, 0.28), (0.134, 0.134, 0.015), 0.9, 10, 12, 150, (-2.2, -0.3), 1.4),
        Joint((0, -0.12, 0.425), Y, 2.28, (0, 0, 0.25), (0.032, 0.032, 0.004), 0.7, 7, 7, 150, (0.2, 2.2), 1.6),
        Joint((0, 0, 0.392), Y, 1.22, (0, 0.02, 0.01), (0.003, 0.002, 0.003), 0.12, 2.2, 1.4, 28, (-2.0, 0.5), 2.2),
        Joint((0, 0.093, 0), Z, 1.22, (0, 0.01, 0.02), (0.003, 0.003, 0.002), 0.12, 2.0, 1.3, 28, (-1.6, 1.6), 2.2),
        Joint((0, 0, 0.095), Y, 0.4, (0.01, 0.03, 0), (0.0005, 0.0004, 0.0005), 0.11, 1.6, 1.1, 28, (-1.8, 1.8), 2.4),
    ),
)
PANDA = ForeignArm(
    "seven",
    (
        Joint(
            (0, 0, 0.333),
            Z,
            4.97,
            (0.004, 0.002, -0.05),
            (0.06, 0.06, 0.01),
            0.55,
            3.2,
            2.2,
            87,
            (-1.4, 1.4),
            1.5,
            loaded=False,
        ),
        Joint(
            (0, 0, 0),
            Z,
            2.65,
            (-0.003, -0.07, 0.003),
            (0.02, 0.01, 0.02),
            0.6,
            3.4,
            2.6,
            87,
            (-1.0, 1.0),
            1.3,
            rpy=_UPRIGHT,
        ),
        Joint(
            (0, -0.316, 0),
            Z,
            3.23,
            (0.03, 0.04, -0.07),
            (0.04, 0.03, 0.01),
            0.45,
            2.8,
            1.8,
            87,
            (-1.4, 1.4),
            1.5,
            rpy=_FLAT,
        ),
        Joint(
            (0.0825, 0, 0),
            Z,
            3.59,
            (-0.05, 0.1, 0.03),
            (0.03, 0.02, 0.03),
            0.45,
            2.9,
            1.8,
            87,
            (-2.3, -0.4),
            1.4,
            rpy=_FLAT,
        ),
        Joint(
            (-0.0825, 0.384, 0),
            Z,
            1.73,
            (-0.01, 0.04, -0.04),
            (0.036, 0.03, 0.009),
            0.12,
            1.6,
            0.8,
            12,
            (-1.4, 1.4),
            1.8,
            rpy=_UPRIGHT,
        ),
        Joint(
            (0, 0, 0),
            Z,
            1.67,
            (0.06, -0.014, -0.01),
            (0.002, 0.004, 0.005),
            0.12,
            1.4,
            0.8,
            12,
            (0.3, 2.4),
            1.8,
            rpy=_FLAT,
        ),
        Joint(
            (0.088, 0, 0),
            Z,
            0.94,
            (0.01, -0.004, 0.08),
            (0.013, 0.01, 0.005),
            0.11,
            1.2,
            0.7,
            12,
            (-1.6, 1.6),
            2.0,
            rpy=_FLAT,
        ),
    ),
)
PALLETISER = ForeignArm(
    "palletiser",
    (
        Joint(
            (0, 0, 0.6),
            Z,
            120,
            (0.05, 0, 0.1),
            (4.0, 4.0, 5.0),
            40,
            110,
            80,
            2500,
            (-1.2, 1.2),
            1.2,
            gear=140,
            torque_constant=0.9,
            loaded=False,
        ),
        Joint(
            (0.2, 0, 0.3),
            Y,
            65,
            (0, 0, 0.4),
            (4.5, 4.5, 0.4),
            45,
            120,
            90,
            2800,
            (-0.6, 0.8),
            1.0,
            gear=150,
            torque_constant=0.9,
        ),
        Joint(
            (0, 0, 0.9),
            Y,
            40,
            (0.45, 0, 0.02),
            (0.4, 3.0, 3.0),
            35,
            90,
            70,
            2200,
            (-0.6, 0.7),
            1.1,
            gear=140,
            torque_constant=0.9,
        ),
        Joint(
            (1.0, 0, 0),
            Y,
            12,
            (0.12, 0, -0.03),
            (0.15, 0.2, 0.15),
            4,
            18,
            10,
            350,
            (-1.0, 1.2),
            1.6,
            gear=90,
            torque_constant=0.6,
        ),
    ),
    coupling=((3, 2, -1.0), (4, 3, -1.0)),
)
SCARA = ForeignArm(
    "scara",
    (
        Joint(
            (0, 0, 0.4), Z, 9, (0.15, 0, 0), (0.03, 0.15, 0.15), 0.7, 5, 4, 120, (-1.6, 1.6), 2.5, gear=50, loaded=False
        ),
        Joint(
            (0.325, 0, 0),
            Z,
            7,
            (0.14, 0, 0.05),
            (0.03, 0.11, 0.11),
            0.35,
            3,
            2,
            70,
            (-1.9, 1.9),
            3.0,
            gear=50,
            loaded=False,
        ),
        Joint(
            (0.275, 0, 0),
            Z,
            1.4,
            (0, 0, -0.1),
            (0.01, 0.01, 0.002),
            6.0,
            18,
            60,
            260,
            (-0.13, 0.02),
            0.35,
            gear=400,
            torque_constant=0.15,
            step=2e-6,
            loaded=False,
            prismatic=True,
        ),
        Joint(
            (0, 0, -0.2),
            Z,
            0.7,
            (0.012, 0.006, -0.03),
            (0.002, 0.002, 0.003),
            0.03,
            0.5,
            0.15,
            8,
            (-2.5, 2.5),
            5.0,
            gear=20,
            loaded=False,
        ),
    ),
)
GANTRY = ForeignArm(
    "gantry",
    (
        Joint(
            (0, 0, 1.6),
            (1.0, 0.0, 0.0),
            85,
            (0, 0, 0),
            (6, 4, 8),
            30,
            70,
            120,
            1500,
            (-0.6, 0.6),
            0.8,
            gear=120,
            torque_constant=0.5,
            step=5e-6,
            loaded=False,
            prismatic=True,
        ),
        Joint(
            (0, 0, 0),
            Y,
            35,
            (0, 0, 0.1),
            (1.5, 1.2, 1.2),
            18,
            45,
            80,
            900,
            (-0.5, 0.5),
            0.8,
            gear=120,
            torque_constant=0.5,
            step=5e-6,
            loaded=False,
            prismatic=True,
        ),
        Joint(
            (0, 0, -0.2),
            Z,
            14,
            (0, 0, 0.2),
            (0.5, 0.5, 0.1),
            9,
            30,
            50,
            500,
            (-0.35, 0.35),
            0.6,
            gear=120,
            torque_constant=0.4,
            step=5e-6,
            loaded=False,
            prismatic=True,
        ),
        Joint(
            (0, 0, -0.4), Y, 3.5, (0.06, 0, -0.09), (0.02, 0.03, 0.02), 0.25, 2.2, 1.2, 40, (-1.8, 1.8), 2.5, gear=60
        ),
    ),
)
TWO_LINK = ForeignArm(
    "two_link",
    (
        Joint((0, 0, 0.5), Y, 6.5, (0, 0, 0.2), (0.07, 0.07, 0.006), 0.8, 6, 5, 110, (-1.4, 1.2), 1.8, gear=80),
        Joint((0, 0, 0.4), Y, 2.4, (0.01, 0, 0.17), (0.02, 0.02, 0.002), 0.25, 2.5, 2, 45, (-2.0, 1.6), 2.4, gear=60),
    ),
)
ARMS = {arm.name: arm for arm in (UR, PANDA, PALLETISER, SCARA, GANTRY, TWO_LINK)}


def urdf(arm: ForeignArm, *, friction: bool, springy: int | None = None) -> str:
    """The text of its URDF file; ``friction``: Coulomb and viscous friction are in it.

    springy   joint (from 1) that is two: ``motorN`` turns a rotor without mass of its own, and ``jointN`` deflects from
              there by a spring or a gap that the file does not describe
    """
    robot = xml.Element("robot", name=arm.name)
    xml.SubElement(robot, "link", name="base")
    parent = "base"
    for number, joint in enumerate(arm.joints, 1):
        name, xyz, rpy = f"joint{number}", joint.xyz, joint.rpy
        if number == springy:
            _add_link(robot, f"rotor{number}", 1e-5, (0.0, 0.0, 0.0), (1e-7, 1e-7, 1e-7))
            _add_joint(robot, joint, f"motor{number}", (parent, f"rotor{number}"), (xyz, rpy), limited=False)
            parent, xyz, rpy = f"rotor{number}", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        _add_link(robot, f"link{number}", joint.mass, joint.com, joint.inertia)
        made = _add_joint(robot, joint, name, (parent, f"link{number}"), (xyz, rpy), limited=friction)
        parent = f"link{number}"
        if friction:
            xml.SubElement(made, "dynamics", damping=repr(joint.viscous), friction=repr(joint.coulomb))
        transmission = xml.SubElement(robot, "transmission", name=f"drive{number}")
        xml.SubElement(transmission, "joint", name=name)
        motor = xml.SubElement(transmission, "actuator", name=f"motor{number}")
        xml.SubElement(motor, "mechanicalReduction").text = repr(joint.gear)
    return xml.tostring(robot, encoding="unicode")


def _text(values: Triple) -> str:
    return " ".join(repr(float(value)) for value in values)


def _add_link(robot: xml.Element, name: str, mass: float, com: Triple, inertia: Triple) -> None:
    inertial = xml.SubElement(xml.SubElement(robot, "link", name=name), "inertial")
    xml.SubElement(inertial, "origin", xyz=_text(com), rpy="0 0 0")
    xml.SubElement(inertial, "mass", value=repr(float(mass)))
    entries = {"ixx": inertia[0], "iyy": inertia[1], "izz": inertia[2], "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    xml.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in entries.items()})


def _add_joint(
    robot: xml.Element, joint: Joint, name: str, ends: tuple[str, str], place: tuple[Triple, Triple], *, limited: bool
) -> xml.Element:
    kind = "prismatic" if joint.prismatic else "revolute" if limited else "continuous"
    made = xml.SubElement(robot, "joint", name=name, type=kind)
    xml.SubElement(made, "parent", link=ends[0])
    xml.SubElement(made, "child", link=ends[1])
    xml.SubElement(made, "origin", xyz=_text(place[0]), rpy=_text(place[1]))
    xml.SubElement(made, "axis", xyz=_text(joint.axis))
    if limited:
        low, high = (
            bound + sign * 0.2 * (joint.reach[1] - joint.reach[0]) for bound, sign in zip(joint.reach, (-1, 1))
        )
        xml.SubElement(
            made,
            "limit",
            lower=repr(low),
            upper=repr(high),
            effort=repr(float(joint.rated * 2)),
            velocity=repr(2 * joint.speed),
        )
    return made
