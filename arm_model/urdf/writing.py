"""URDF out: the kinematics, inertias, limits and joint friction of an arm; what has no place there is said."""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from pathlib import Path

import numpy as np

from arm_io import InputError, write_text
from arm_io.types import Array
from arm_model.branches import listed
from arm_model.description import Arm, Joint
from arm_model.rigid_body.friction_curve import nearest_line
from arm_model.rigid_body.kinematics import placement, rpy_of
from arm_model.urdf.reading import UNKNOWN


def _text(values: Array | tuple[float, ...] | list[float]) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)


def _text_of_origin(pose: Array) -> dict[str, str]:
    return {"xyz": _text(pose[:3, 3]), "rpy": _text(rpy_of(pose))}


def not_in_urdf(arm: Arm, form: str = "URDF") -> list[str]:
    """One sentence per joint whose friction the file cannot express, and one that names the effects it cannot hold.

    Friction of a drive and of the joint's own axis are one in URDF: without couplings, both follow the same motion.
    form: name of the format, URDF or another with one Coulomb and one viscous coefficient per joint.
    """
    sentences = []
    for number, joint in enumerate(arm.joints, 1):
        _, _, off = nearest_line(joint)
        if joint.friction_curve is not None or off > 1e-9:
            what = "has a friction curve" if joint.friction_curve is not None else "differs between the directions"
            sentences.append(
                f"friction of joint {number} {what}; {form} has one Coulomb and one viscous coefficient: the nearest "
                f"line is written, off by up to {off:.2g} {'N m' if joint.revolute else 'N'}"
            )
        if joint.temperature is not None:
            sentences.append(
                f"friction of joint {number} is that at {joint.temperature:g} degC and without load; {form} has no "
                "place for either"
            )
    if arm.effects:
        names = sorted({term.name for term in arm.effects})
        sentences.append(f"{form} has no place for effects; left out: {', '.join(names)}")
    return sentences


def unknown_in_urdf(arm: Arm) -> list[str]:
    """One sentence for each kind of limit that the arm lacks and ``write_urdf`` writes, since URDF requires a number.

    A revolute joint without limits of its position is "continuous", and needs none.
    """
    lacking = {
        "travel": [not joint.revolute and joint.limits is None for joint in arm.joints],
        "effort": [joint.torque_limit is None for joint in arm.joints],
        "velocity": [joint.motor_speed_limit is None for joint in arm.joints],
    }
    sentences = []
    for what, lacks in lacking.items():
        if numbers := [str(number) for number, missing in enumerate(lacks, 1) if missing]:
            joints = f"joint{'s' * (len(numbers) > 1)} {listed(numbers)}"
            sentences.append(
                f"URDF requires a limit of {what}, and the model has none of {joints}: {UNKNOWN:g} is written"
            )
    return sentences


def write_urdf(path: str | Path, arm: Arm) -> None:
    """Writes the arm as URDF: link frames on the joints' axes, joint-side friction, the tool as a fixed link "tool".

    Rotor inertias, torque constants, effects and the controller have no place in URDF and are left out; friction of
    other shape than Coulomb and viscous, equal in both directions, becomes the nearest such (``not_in_urdf`` says so).
    A limit that the arm lacks and URDF requires is ``UNKNOWN``, which ``read_urdf`` takes for none.
    InputError for an arm with coupled joints, which URDF cannot describe.
    """
    if arm.coupling:
        raise InputError(path, "URDF has no place for [[coupling]]; write the arm as .toml")
    robot = xml.Element("robot", name=arm.name)
    xml.SubElement(robot, "link", name="base")
    pose, parent = np.array(arm.base), "base"
    for number, joint in enumerate(arm.joints, 1):
        before, after = placement(joint)
        name = f"link{number}"
        _write_joint(robot, joint, f"joint{number}", parent, name, pose @ before)
        _write_link(robot, joint, name, after)
        if joint.gear != 1.0:
            _write_gear(robot, joint, joint.name or f"joint{number}")
        pose, parent = after, name
    fixed = xml.SubElement(robot, "joint", name="flange", type="fixed")
    xml.SubElement(fixed, "parent", link=parent)
    xml.SubElement(fixed, "child", link="tool")
    xml.SubElement(fixed, "origin", _text_of_origin(pose @ np.array(arm.tool)))
    xml.SubElement(robot, "link", name="tool")
    xml.indent(robot)
    write_text(path, xml.tostring(robot, encoding="utf-8", xml_declaration=True).decode())


def _write_joint(robot: xml.Element, joint: Joint, name: str, parent: str, child: str, origin: Array) -> None:
    kind = joint.type if joint.limits or not joint.revolute else "continuous"
    element = xml.SubElement(robot, "joint", name=joint.name or name, type=kind)
    xml.SubElement(element, "parent", link=parent)
    xml.SubElement(element, "child", link=child)
    xml.SubElement(element, "origin", _text_of_origin(origin))
    xml.SubElement(element, "axis", xyz="0 0 1")
    limit = {} if kind == "continuous" else dict(zip(("lower", "upper"), joint.limits or (-UNKNOWN, UNKNOWN)))
    speed = UNKNOWN if joint.motor_speed_limit is None else joint.motor_speed_limit / joint.ratio
    limit |= {"effort": UNKNOWN if joint.torque_limit is None else joint.torque_limit, "velocity": speed}
    xml.SubElement(element, "limit", {key: repr(float(value)) for key, value in limit.items()})
    friction, damping, _ = nearest_line(joint)
    dynamics = {"damping": repr(damping), "friction": repr(friction)}
    xml.SubElement(element, "dynamics", dynamics)


def _write_gear(robot: xml.Element, joint: Joint, name: str) -> None:
    transmission = xml.SubElement(robot, "transmission", name=f"{name}_transmission")
    xml.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    xml.SubElement(transmission, "joint", name=name)
    actuator = xml.SubElement(transmission, "actuator", name=f"{name}_motor")
    xml.SubElement(actuator, "mechanicalReduction").text = repr(float(joint.gear))


def _write_link(robot: xml.Element, joint: Joint, name: str, after: Array) -> None:
    link = xml.SubElement(robot, "link", name=name)
    inertial = xml.SubElement(link, "inertial")
    centre = after.copy()
    centre[:3, 3] = after[:3, :3] @ np.array(joint.com) + after[:3, 3]
    xml.SubElement(inertial, "origin", _text_of_origin(centre))
    xml.SubElement(inertial, "mass", value=repr(float(joint.mass)))
    names = ("ixx", "iyy", "izz", "ixy", "iyz", "ixz")
    xml.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in zip(names, joint.inertia)})
