"""The URDF file that a stranger has of a foreign arm."""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813

from tests.foreign.arms import ForeignArm, Joint, Triple


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
