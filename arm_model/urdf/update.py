"""A URDF file with the numbers of an identified arm: only what differs changes, byte for byte the rest stays."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from arm_io import InputError, read_file, write_text
from arm_io.types import Array
from arm_model.description import Arm, Joint
from arm_model.rigid_body.friction_curve import nearest_line
from arm_model.rigid_body.inertia import about_com, barycentric, transform, unphysical
from arm_model.rigid_body.kinematics import roll_pitch_yaw, rpy_of
from arm_model.urdf.reading import read_urdf
from arm_model.xml_edit import Element, XmlText, differ, number, vector

_ENTRIES = ("ixx", "iyy", "izz", "ixy", "iyz", "ixz")


def update_urdf(original: str | Path, arm: Arm, out: str | Path, *, tip: str | None = None) -> list[str]:
    """Writes the URDF file ``original`` with the masses, centres, inertias, friction and joint origins of ``arm``.

    Returns what changed, one line each. Names, meshes, comments, order and white space stay. What hangs on a moving
    link keeps its own inertial, and the link gets the rest; if the rest is not physical, the link gets all, and what is
    fixed to it nothing.

    InputError where the arm has other joints than the file, where a number to change is an expression of xacro, where a
    link would need the mass of a hand that moves on it, or the file cannot be written.
    """
    before = read_urdf(original, tip=tip)
    text = XmlText(original, read_file(original))
    names, of_model = [joint.name for joint in before.joints], [joint.name for joint in arm.joints]
    if names != of_model:
        shorter = "; --tip LINK names the arm's last link" if set(of_model) < set(names) else ""
        raise InputError(original, f"has the joints {', '.join(names)}; the model has {', '.join(of_model)}{shorter}")
    changed: list[str] = []
    for was, now in zip(before.joints, arm.joints):
        element = text.root.named("joint", now.name)
        assert element is not None
        changed += _origin(text, original, element, was, now) + _friction(text, element, was, now)
        changed += _inertial(text, element, was, now, names)
    write_text(out, text.text())
    return changed


def _origin(text: XmlText, path: str | Path, element: Element, was: Joint, now: Joint) -> list[str]:
    """The pose of a joint, where calibration has moved it."""
    if not (differ(was.xyz, now.xyz) or differ(was.rpy, now.rpy) or differ(was.axis, now.axis)):
        return []
    if now.convention != "placed" or differ(was.axis, now.axis):
        raise InputError(path, f"joint {now.name!r} has another axis or convention in the model; URDF needs it placed")
    old, new = _pose(was.xyz, was.rpy), _pose(now.xyz, now.rpy)
    origin = element.child("origin")
    _set_pose(text, element, origin, _read_pose(origin) @ np.linalg.inv(old) @ new)
    return [f"joint {now.name}: origin"]


def _friction(text: XmlText, element: Element, was: Joint, now: Joint) -> list[str]:
    """Viscous and Coulomb friction at the joint, means of both directions."""
    old, new = nearest_line(was)[:2], nearest_line(now)[:2]
    if not differ(old, new):
        return []
    values = {"damping": number(new[1]), "friction": number(new[0])}
    dynamics = element.child("dynamics")
    if dynamics is None:
        text.add(element, "<dynamics " + " ".join(f'{name}="{value}"' for name, value in values.items()) + "/>")
    else:
        text.set(dynamics, **values)
    return [f"joint {now.name}: friction"]


def _inertial(text: XmlText, element: Element, was: Joint, now: Joint, names: Sequence[str]) -> list[str]:
    """Mass, centre and inertia of the link behind a joint; names: of the arm's joints."""
    if not any(differ(getattr(was, name), getattr(now, name)) for name in ("mass", "com", "inertia")):
        return []
    child = element.child("child")
    link = None if child is None else text.root.named("link", child.attributes["link"])
    assert link is not None
    total, old = (barycentric(joint.mass, joint.com, joint.inertia) for joint in (now, was))
    inertial = _read_inertial(link)
    own = total - (old - inertial)
    mass, _, inertia = about_com(own)
    if wrong := unphysical(mass, inertia):
        hung = _hung_on(text, link.attributes["name"], names)
        if any(moves for _, moves in hung):
            raise InputError(
                text.path,
                f"link {link.attributes['name']!r}: {now.mass:.4g} kg are not possible for it and what moves on it: "
                f"without that its {wrong}; write the arm as .toml",
            )
        for fixed, _ in hung:
            _set_inertial(text, fixed, np.zeros(10))
        own = total
    _set_inertial(text, link, own)
    return [f"link {link.attributes['name']}: mass {was.mass:.6g} -> {now.mass:.6g} kg, with what is fixed to it"]


def _hung_on(text: XmlText, link: str, arm: Collection[str]) -> list[tuple[Element, bool]]:
    """Links with inertials that hang on a link, but not by a joint of the arm, and whether they move."""
    hung: list[tuple[Element, bool]] = []
    for joint in text.root.children:
        parent, child = joint.child("parent"), joint.child("child")
        if joint.tag != "joint" or joint.attributes.get("name") in arm or parent is None or child is None:
            continue
        if parent.attributes.get("link") == link:
            below, moves = text.root.named("link", child.attributes["link"]), joint.attributes.get("type") != "fixed"
            hung += [(below, moves)] if below is not None and below.child("inertial") else []
            hung += [(one, moves or other) for one, other in _hung_on(text, child.attributes["link"], arm)]
    return hung


def _read_inertial(link: Element) -> Array:
    """(10,) barycentric parameters of a link in its own frame, as the file has them."""
    inertial = link.child("inertial")
    if inertial is None:
        return np.zeros(10)
    mass, tensor = inertial.child("mass"), inertial.child("inertia")
    weight = 0.0 if mass is None else float(mass.attributes.get("value", 0.0))
    entries = tuple(0.0 if tensor is None else float(tensor.attributes.get(name, 0.0)) for name in _ENTRIES)
    return transform(barycentric(weight, (0.0, 0.0, 0.0), entries), _read_pose(inertial.child("origin")))


def _set_inertial(text: XmlText, link: Element, parameters: Array) -> None:
    """Gives a link (10,) barycentric parameters; the axes of its inertial stay as they are."""
    mass, com, entries = about_com(parameters)
    inertial = link.child("inertial")
    pose = np.eye(4) if inertial is None else _read_pose(inertial.child("origin"))
    turned = pose[:3, :3].T @ _tensor(entries) @ pose[:3, :3]
    values = {name: number(turned["xyz".index(name[1]), "xyz".index(name[2])]) for name in _ENTRIES}
    pose[:3, 3] = com
    tensor = "<inertia " + " ".join(f'{name}="{value}"' for name, value in values.items()) + "/>"
    if inertial is None:
        origin = f'<origin xyz="{vector(pose[:3, 3])}" rpy="0 0 0"/>'
        text.add(link, f'<inertial>{origin}<mass value="{number(mass)}"/>{tensor}</inertial>')
        return
    _set_pose(text, inertial, inertial.child("origin"), pose)
    for tag, new in (("mass", {"value": number(mass)}), ("inertia", values)):
        child = inertial.child(tag)
        if child is None:
            text.add(inertial, tensor if tag == "inertia" else f'<mass value="{new["value"]}"/>')
        else:
            text.set(child, **new)


def _set_pose(text: XmlText, parent: Element, origin: Element | None, pose: Array) -> None:
    """Gives an element's <origin> a pose; an orientation that stays is not touched."""
    xyz, turned = vector(pose[:3, 3]), differ(pose[:3, :3], _read_pose(origin)[:3, :3])
    if origin is None:
        rpy = f' rpy="{vector(np.array(rpy_of(pose)))}"' if turned else ""
        text.add(parent, f'<origin xyz="{xyz}"{rpy}/>')
        return
    text.set(origin, xyz=xyz)
    if turned:
        text.set(origin, rpy=vector(np.array(rpy_of(pose))))


def _read_pose(origin: Element | None) -> Array:
    """(4, 4) of an <origin>; one with an expression of xacro has been refused by ``read_urdf``."""
    attributes = {} if origin is None else origin.attributes
    xyz, rpy = ([float(part) for part in attributes.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
    return _pose((xyz[0], xyz[1], xyz[2]), (rpy[0], rpy[1], rpy[2]))


def _pose(xyz: tuple[float, float, float], rpy: tuple[float, float, float]) -> Array:
    pose = roll_pitch_yaw(rpy)
    pose[:3, 3] = xyz
    return pose


def _tensor(entries: tuple[float, ...]) -> Array:
    x, y, z, xy, yz, xz = entries
    return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
