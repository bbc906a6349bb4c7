"""URDF files with what files of strangers have, and no arm of ours: fixed frames, mimic joints, hands, odd names.

Each change keeps what the arm is, or leaves out what a file may leave out.
"""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813

import numpy as np

Generator = np.random.Generator
SHARE = 0.2
"""of the changes, a file gets so many."""
NAMES = (
    "arm/joint {0}",
    "joint.{0}",
    "関節{0}",
    "{0}",
    "q{0}",
    "i{0}",
    "t{0}",
    "panda_joint{0}",
    "Joint-{0} [rad]",
    "A1,{0}",
)


def dressed(text: str, rng: Generator) -> str:
    """The file with some of ``CHANGES``."""
    robot = xml.fromstring(text)
    for change in CHANGES:
        if rng.random() < SHARE:
            change(robot, rng)
    xml.indent(robot)
    return xml.tostring(robot, encoding="unicode")


def _moving(robot: xml.Element) -> list[xml.Element]:
    return [one for one in robot.findall("joint") if one.get("type") != "fixed"]


def _one(robot: xml.Element, rng: Generator) -> xml.Element:
    joints = _moving(robot)
    return joints[int(rng.integers(len(joints)))]


def _fix(robot: xml.Element, name: str, parent: str, child: str, origin: xml.Element | None = None) -> None:
    joint = xml.SubElement(robot, "joint", name=name, type="fixed")
    xml.SubElement(joint, "parent", link=parent)
    xml.SubElement(joint, "child", link=child)
    if origin is not None:
        joint.append(origin)


def _world(robot: xml.Element, _: Generator) -> None:
    """The base stands on a link of its own."""
    xml.SubElement(robot, "link", name="world")
    _fix(robot, "world_joint", "world", "base")


def _frame(robot: xml.Element, rng: Generator) -> None:
    """A fixed frame before a joint, which then begins where the frame is."""
    joint = _one(robot, rng)
    parent, origin = joint.find("parent"), joint.find("origin")
    assert parent is not None and origin is not None
    xml.SubElement(robot, "link", name="frame")
    _fix(robot, "frame_fixed", parent.get("link", ""), "frame", origin)
    parent.set("link", "frame")
    joint.remove(origin)


def _hand(robot: xml.Element, _: Generator) -> None:
    """Two fingers, of which one follows the other; beside one or two joints nobody could say which are the arm."""
    if len(_moving(robot)) < 3:
        return
    for side in ("left", "right"):
        xml.SubElement(robot, "link", name=side)
        joint = xml.SubElement(robot, "joint", name=f"{side}_finger", type="prismatic")
        xml.SubElement(joint, "parent", link="tool")
        xml.SubElement(joint, "child", link=side)
        xml.SubElement(joint, "limit", lower="0", upper="0.04", effort="20", velocity="0.2")
    xml.SubElement(robot.findall("joint")[-1], "mimic", joint="left_finger")


def _mimic(robot: xml.Element, rng: Generator) -> None:
    """A joint of the arm follows another one."""
    joint = _one(robot, rng)
    xml.SubElement(joint, "mimic", joint=_one(robot, rng).get("name", ""), multiplier="-1", offset="0.1")


def _no_range(robot: xml.Element, rng: Generator) -> None:
    """Limits that a tool wrote for want of others."""
    limit = _one(robot, rng).find("limit")
    assert limit is not None
    for name in limit.attrib:
        limit.set(name, "0")


def _without(name: str):
    """An element that a joint may lack."""

    def change(robot: xml.Element, rng: Generator) -> None:
        joint = _one(robot, rng)
        if (found := joint.find(name)) is not None:
            joint.remove(found)

    return change


def _continuous(robot: xml.Element, rng: Generator) -> None:
    """With limits all the same."""
    joint = _one(robot, rng)
    if joint.get("type") == "revolute":
        joint.set("type", "continuous")


def _damping_alone(robot: xml.Element, rng: Generator) -> None:
    found = _one(robot, rng).find("dynamics")
    if found is not None:
        found.attrib.pop("friction", None)


def _no_inertia(robot: xml.Element, rng: Generator) -> None:
    """A link without <inertial>, or with a mass alone."""
    links = [one for one in robot.findall("link") if one.find("inertial") is not None]
    link = links[int(rng.integers(len(links)))]
    inertial = link.find("inertial")
    assert inertial is not None
    if rng.random() < 0.5:
        link.remove(inertial)
        return
    for name in ("inertia", "origin"):
        if (found := inertial.find(name)) is not None:
            inertial.remove(found)


def _names(robot: xml.Element, rng: Generator) -> None:
    """Of joints: with slashes, dots, blanks, letters of other languages, or those of columns."""
    form = str(rng.choice(NAMES))
    new = {one.get("name"): form.format(number) for number, one in enumerate(_moving(robot), 1)}
    for element in robot.iter():
        for key in ("name", "joint"):
            if element.tag in ("joint", "mimic") and element.get(key) in new:
                element.set(key, new[element.get(key)])


CHANGES = (
    _names,
    _frame,
    _world,
    _hand,
    _mimic,
    _no_range,
    _without("limit"),
    _without("dynamics"),
    _without("axis"),
    _continuous,
    _damping_alone,
    _no_inertia,
)
