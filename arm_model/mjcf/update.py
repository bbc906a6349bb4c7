"""A MuJoCo model (MJCF) with the numbers of an identified arm: only what differs changes, every other byte stays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from arm_io import InputError, write_text
from arm_io.types import Array
from arm_model.description import Arm, Joint
from arm_model.mjcf.reading import Body, Reading, read_all
from arm_model.mjcf.tree import ORIENTATIONS, Attributes, Include, Node, Tree
from arm_model.rigid_body.friction_curve import nearest_line
from arm_model.rigid_body.inertia import about_com, barycentric, transform, unphysical
from arm_model.xml_edit import CLOSE, differ, number, vector

_UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Entries of a tensor in the order of fullinertia."""


def update_mjcf(original: str | Path, arm: Arm, out: str | Path, *, tip: str | None = None) -> list[str]:
    """Writes the MJCF ``original`` with the inertials, damping, frictionloss, armature and ranges of ``arm``.

    Returns what changed, one line each. Names, meshes, comments, order, defaults and white space stay. A number that a
    default class gives is written at the joint itself. What hangs on a moving body keeps its own inertial, and the
    body gets the rest; if the rest is not physical, the body gets all, and what is fixed to it nothing. An included
    file with numbers that change is written beside ``out``, under its own name and that of ``out``.

    InputError where the arm has other joints than the file, or joints at other places, or a file cannot be written.
    """
    reading = read_all(original, tip=tip)
    before = reading.arm
    if arm.coupling:
        raise InputError(original, "has no place for [[coupling]]; write the arm as .toml")
    names, of_model = [joint.name for joint in before.joints], [joint.name for joint in arm.joints]
    if names != of_model:
        raise InputError(original, f"has the joints {', '.join(names)}; the model has {', '.join(of_model)}")
    changed: list[str] = []
    for place, (was, now) in enumerate(zip(before.joints, arm.joints)):
        for name in ("xyz", "rpy", "axis"):
            if now.convention != "placed" or differ(getattr(was, name), getattr(now, name)):
                raise InputError(
                    original,
                    f"joint {now.name!r} is placed elsewhere in the model; only numbers of the dynamics are written",
                )
        node, given = reading.joints[place]
        changed += _joint(reading.tree, node, given, was, now) + _inertial(reading, place, was, now)
    _write(reading.tree, Path(out))
    return changed


def _joint(tree: Tree, node: Node, given: Attributes, was: Joint, now: Joint) -> list[str]:
    """Friction, armature and range of a joint, where they changed."""
    changed = []
    for name, old, new in (
        ("frictionloss", nearest_line(was)[0], nearest_line(now)[0]),
        ("damping", nearest_line(was)[1], nearest_line(now)[1]),
        ("armature", was.ratio**2 * was.rotor_inertia, now.ratio**2 * now.rotor_inertia),
    ):
        if differ(old, new):
            node.text.set(node.element, **{name: number(new)})
            changed.append(f"joint {now.name}: {name} {old:.6g} -> {new:.6g}")
    if now.limits is not None and (was.limits is None or differ(was.limits, now.limits)):
        unit = tree.angle if now.revolute else 1.0
        node.text.set(node.element, range=vector(np.array(now.limits) / unit))
        if given.get("limited", "auto") == "false" or tree.compiler.get("autolimits", "true") == "false":
            node.text.set(node.element, limited="true")
        changed.append(f"joint {now.name}: range")
    return changed


def _inertial(reading: Reading, link: int, was: Joint, now: Joint) -> list[str]:
    """Mass, centre and inertia of the bodies of a link."""
    if not any(differ(getattr(was, name), getattr(now, name)) for name in ("mass", "com", "inertia")):
        return []
    parts = [one for one in reading.bodies if one.link == link]
    if not parts:
        raise InputError(
            reading.tree.path, f"joint {was.name!r} shares its body with the next one; it has no place for a mass"
        )
    main, *fixed = parts
    back: Array = np.asarray(np.linalg.inv(main.pose), float)
    total = transform(barycentric(now.mass, now.com, now.inertia), back)
    own = total
    for one in fixed:
        own = own - transform(one.parameters, back @ one.pose)
    mass, _, inertia = about_com(own)
    if wrong := "mass is zero" if mass == 0 else unphysical(mass, inertia):
        if any(one.moves and np.any(one.parameters) for one in fixed):
            raise InputError(
                reading.tree.path,
                f"body {main.node.name!r}: {now.mass:.4g} kg are not possible for it and what moves on it: "
                f"without that its {wrong}; write the arm as .toml",
            )
        for one in fixed:
            if np.any(one.parameters):
                _set_inertial(reading.tree, one, np.zeros(10))
        own = total
    _set_inertial(reading.tree, main, own)
    return [f"body {main.node.name}: mass {was.mass:.6g} -> {now.mass:.6g} kg, with what is fixed to it"]


def _set_inertial(tree: Tree, body: Body, parameters: Array) -> None:
    """Gives a body (10,) parameters in its own frame, in the form that its <inertial> has."""
    if tree.compiler.get("inertiafromgeom") == "true":
        raise InputError(tree.path, "inertiafromgeom is 'true': MuJoCo would not use an <inertial>; remove it")
    mass, com, (x, y, z, xy, yz, xz) = about_com(parameters)
    tensor = np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
    values = {"mass": number(mass), "pos": vector(np.array(com))}
    full = {"fullinertia": vector(np.array([tensor[place] for place in _UPPER]))}
    if mass == 0.0:  # which MuJoCo allows of a fixed body, but not as a full tensor
        full = {"diaginertia": "0 0 0"}
    found = body.node.all("inertial")
    if not found:
        sizes = " ".join(f'{name}="{value}"' for name, value in (values | full).items())
        body.node.text.add(body.node.element, f"<inertial {sizes}/>")
        return
    text, element = found[0].text, found[0].element
    if "fullinertia" in element.attributes:
        if mass == 0.0:
            text.drop(element, "fullinertia")
        text.set(element, **values, **full)
        return
    axes = tree.rotation(element.attributes)
    turned = axes.T @ tensor @ axes
    if np.abs(turned - np.diag(turned.diagonal())).max() > CLOSE * max(float(np.abs(turned).max()), 1e-12):
        principal, axes = np.linalg.eigh(tensor)
        axes = axes * np.sign(np.linalg.det(axes))
        turned = np.diag(principal)
        for name in ORIENTATIONS:
            if name != "quat" and name in element.attributes:
                text.drop(element, name)
        text.set(element, quat=vector(_quaternion(axes)))
    text.set(element, **values, diaginertia=vector(turned.diagonal()))


def _quaternion(rotation: Array) -> Array:
    """(4,) w, x, y, z of a rotation (3, 3), w not negative."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True)[[3, 0, 1, 2]])


def _write(tree: Tree, out: Path) -> None:
    """Writes the model, and beside it the included files that changed; the <include> of each names the new file."""
    changed = list(_changed(tree, out))
    for include, name in changed:
        include.text.set(include.element, file=name)
    for include, name in changed:
        write_text(out.parent / name, include.content.text())
    write_text(out, tree.text.text())


def _changed(tree: Tree, out: Path) -> Iterator[tuple[Include, str]]:
    """Included files with edits, and those that include them, each with its new name."""
    marked: set[int] = set()
    for include in reversed(tree.includes):  # those inside others come later
        if include.content.edited or id(include.content) in marked:
            marked.add(id(include.text))
            given = Path(include.element.attributes["file"])
            yield include, str(given.with_name(f"{given.stem}_{out.stem}{given.suffix}"))
