"""The elements of a MuJoCo model (MJCF): its includes in their places, default classes, orientations.

See https://mujoco.readthedocs.io/en/stable/XMLreference.html. Every element knows the text that it stands in, so that
``arm_model.mjcf.update`` can change it there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from arm_io import InputError, read_file
from arm_io.plain_data import check_plain
from arm_io.types import Array
from arm_model.xml_edit import Element, XmlText

Attributes = dict[str, str]
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
"""Attributes that give an orientation; an element has one of them."""
FLAGS = ("gravity", "equality", "constraint", "passive", "damper", "frictionloss", "limit")
"""What <flag> may disable of what is read or said."""
_UNREAD = ("frame", "replicate", "attach", "composite", "flexcomp")
"""Elements that make bodies or move them in ways that are not read here."""


class NeedsCompiler(InputError):
    """A model with something that only MuJoCo's own compiler reads; ``what``: "has <frame>"."""

    def __init__(self, path: Path, what: str) -> None:
        super().__init__(path, f"{what}, into which nothing can be written; write the arm as .toml or .urdf")
        self.what = what


@dataclass
class Node:
    """An element, the text that it stands in, and its children, those of included files among them."""

    text: XmlText
    element: Element
    children: list[Node]

    @property
    def tag(self) -> str:
        return self.element.tag

    @property
    def name(self) -> str:
        return self.element.attributes.get("name", "")

    def all(self, tag: str) -> list[Node]:
        """Children with a tag."""
        return [one for one in self.children if one.tag == tag]


@dataclass
class Include:
    """An <include> and the file that stands in its place."""

    element: Element
    text: XmlText
    file: Path
    content: XmlText


@dataclass
class Tree:
    """A model: its top-level sections, and what its compiler and its defaults say.

    compiler  attributes of all <compiler> elements together
    defaults  class -> tag -> attributes, with those of the classes above
    """

    path: Path
    text: XmlText
    sections: list[Node]
    includes: list[Include]
    compiler: Attributes = field(default_factory=dict)
    defaults: dict[str, dict[str, Attributes]] = field(default_factory=dict)

    def all(self, tag: str) -> Iterator[Node]:
        """Children of all top-level sections with a tag."""
        return (child for section in self.sections if section.tag == tag for child in section.children)

    def attributes(self, node: Node, childclass: str | None) -> Attributes:
        """Attributes of an element with those of its default class; its own class, else that of the bodies above."""
        name = node.element.attributes.get("class", childclass or "main")
        if name not in self.defaults:
            raise InputError(self.path, f"<{node.tag} name={node.name!r}>: there is no default class {name!r}")
        return {**self.defaults[name].get(node.tag, {}), **node.element.attributes}

    @property
    def disabled(self) -> set[str]:
        """Names of what <flag> of <option> disables in the whole model, as gravity."""
        flags: Attributes = {}
        for section in self.sections:
            if section.tag == "option":
                for flag in section.all("flag"):
                    flags |= flag.element.attributes
        return {name for name, value in flags.items() if value == "disable"}

    @property
    def angle(self) -> float:
        """rad per unit of an angle in the file."""
        return 1.0 if self.compiler.get("angle", "degree") == "radian" else np.pi / 180.0

    def numbers(self, given: Attributes, name: str, default: str, count: int) -> Array:
        """(count,) numbers of an attribute, else of ``default``; InputError where they are others."""
        text = given.get(name, default)
        try:
            values = np.array([float(part) for part in text.split()])
        except ValueError:
            values = np.empty(0)
        if len(values) != count or not np.isfinite(values).all():
            raise InputError(self.path, f"{name}={text!r}: expected {count} numbers")
        check_plain(self.path, {name: values.tolist() if count > 1 else float(values[0])})
        return values

    def pose(self, given: Attributes) -> Array:
        """(4, 4) of an element in its parent, by its pos and orientation."""
        pose = np.eye(4)
        pose[:3, :3] = self.rotation(given)
        pose[:3, 3] = self.numbers(given, "pos", "0 0 0", 3)
        return pose

    def rotation(self, given: Attributes) -> Array:
        """(3, 3) by the orientation that an element has."""
        kind = next((name for name in ORIENTATIONS if name in given), None)
        if kind is None:
            return np.eye(3)
        if kind == "quat":
            return of_quaternion(self._direction(given, "quat", 4))
        if kind == "axisangle":
            values = self.numbers(given, kind, "", 4)
            return about(_unit(values[:3]), self.angle * values[3])
        if kind == "xyaxes":
            values = self.numbers(given, kind, "", 6)
            x = _unit(values[:3])
            y = _unit(values[3:] - x * (x @ values[3:]))
            return np.column_stack([x, y, np.cross(x, y)])
        if kind == "zaxis":
            return towards(self._direction(given, kind, 3))
        rotation = np.eye(3)
        for letter, angle in zip(self.compiler.get("eulerseq", "xyz"), self.numbers(given, kind, "", 3)):
            turn = about(np.eye(3)["xyz".index(letter.lower())], self.angle * angle)
            rotation = rotation @ turn if letter.islower() else turn @ rotation
        return rotation

    def _direction(self, given: Attributes, name: str, count: int) -> Array:
        values = self.numbers(given, name, "", count)
        if np.linalg.norm(values) < 1e-9:
            raise InputError(self.path, f"{name}={given[name]!r}: needs a direction, is zero")
        return _unit(values)


def read_tree(path: str | Path, content: bytes | None) -> Tree:
    """Reads a file and what it includes.

    ``content``: of the file, where there is none; None: it is read. InputError where it is no MJCF, NeedsCompiler where
    it has elements that are not read here.
    """
    path = Path(path)
    text = XmlText(path, read_file(path) if content is None else content)
    if text.root.tag != "mujoco":
        raise InputError(path, f"is <{text.root.tag}>, not a MuJoCo model <mujoco>")
    tree = Tree(path, text, [], [])
    tree.sections = _expanded(tree, text, text.root.children, {path.resolve()})
    for section in tree.sections:
        if section.tag == "compiler":
            tree.compiler |= section.element.attributes
        elif section.tag == "default":
            _defaults(tree, section, None)
    tree.defaults.setdefault("main", {})
    if set(tree.compiler.get("eulerseq", "xyz").lower()) - set("xyz") or len(tree.compiler.get("eulerseq", "xyz")) != 3:
        raise InputError(path, f"eulerseq={tree.compiler['eulerseq']!r}: expected three of x, y, z")
    return tree


def _expanded(tree: Tree, text: XmlText, elements: list[Element], files: set[Path]) -> list[Node]:
    """Nodes of elements, with included files in place of their <include>."""
    nodes: list[Node] = []
    for element in elements:
        if element.tag in _UNREAD:
            raise NeedsCompiler(tree.path, f"has <{element.tag}>")
        if element.tag != "include":
            nodes.append(Node(text, element, _expanded(tree, text, element.children, files)))
            continue
        file = tree.path.parent / element.attributes.get("file", "")
        if file.resolve() in files:
            raise InputError(tree.path, f"includes {element.attributes.get('file', '')} more than once")
        files.add(file.resolve())
        content = XmlText(file, read_file(file))
        tree.includes.append(Include(element, text, file, content))
        nodes += _expanded(tree, content, content.root.children, files)
    return nodes


def _defaults(tree: Tree, node: Node, above: str | None) -> None:
    """Reads a <default>: its own attributes first, then the classes inside it, which inherit them."""
    name = node.element.attributes.get("class", "main" if above is None else "")
    if not name:
        raise InputError(tree.path, "a <default> inside another needs a class")
    inherited = tree.defaults.get(name) if above is None else tree.defaults[above]
    attributes = {tag: dict(values) for tag, values in (inherited or {}).items()}
    for child in node.children:
        if child.tag != "default":
            attributes[child.tag] = {**attributes.get(child.tag, {}), **child.element.attributes}
    tree.defaults[name] = attributes
    for child in node.all("default"):
        _defaults(tree, child, name)


def of_quaternion(q: Array) -> Array:
    """(3, 3) rotation of a unit quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.roll(q, -1)).as_matrix())


def about(axis: Array, angle: float) -> Array:
    """(3, 3) rotation by an angle, rad, about a unit vector (3,)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def towards(direction: Array) -> Array:
    """(3, 3) the least rotation that takes z to a unit vector (3,)."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-10:
        return np.eye(3) if direction[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return about(axis / sine, float(np.arctan2(sine, direction[2])))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
