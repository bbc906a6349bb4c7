"""MuJoCo models (MJCF): the kinematics, inertias, limits, armature and joint friction of one serial chain.

Of a joint are read its axis, anchor, reference, range, damping, frictionloss and armature; actuators are not: currents
of an arm from MJCF are torques at the joint. Link frames have the orientation of their bodies, and their origin at the
joint's anchor. Inertias of bodies without <inertial> come from their geoms, as MuJoCo infers them. What makes bodies or
moves them (frames, replicas, attachments) and masses of meshes are read by MuJoCo's own compiler, if it is there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.branches import check_names, ends_that_move, joints_of_arm
from arm_model.description import Arm, Joint
from arm_model.mjcf.compiled import compiled_text
from arm_model.mjcf.geom_inertia import geom_inertia
from arm_model.mjcf.tree import Attributes, NeedsCompiler, Node, Tree, about, read_tree
from arm_model.rigid_body.inertia import about_com, barycentric, transform, unphysical
from arm_model.rigid_body.kinematics import rpy_of

SUFFIXES = (".xml", ".mjcf")
_TYPES = {"hinge": "revolute", "slide": "prismatic"}
_SCALING = ("settotalmass", "boundmass", "boundinertia")


@dataclass(frozen=True)
class Body:
    """A body that belongs to a link: ``pose`` (4, 4) in the link's frame, (10,) parameters in its own.

    link        from 0
    childclass  default class of what is in it
    moves       whether it moves against its link in the file: a finger, which counts as fixed
    """

    link: int
    node: Node
    pose: Array
    parameters: Array
    childclass: str | None
    moves: bool = False


@dataclass(frozen=True)
class Reading:
    """An arm, and where its numbers stand: the element of each joint with its attributes, and the bodies.

    end: name of the last body of the chain
    """

    tree: Tree
    arm: Arm
    joints: tuple[tuple[Node, Attributes], ...]
    bodies: tuple[Body, ...]
    end: str


def read_mjcf(path: str | Path, *, tip: str | None = None) -> Arm:
    """The arm in an MJCF file, from the world to body ``tip`` (needed where the moving bodies branch).

    What is fixed to a link is merged into it, and so is what moves beside the chain, as the fingers of a hand, in the
    pose of the file (``mjcf_gaps`` says so). Of a scene, the tree that has actuators is the arm.
    InputError for anything but a serial chain of hinges and slides.
    """
    return read_reading(path, tip=tip).arm


def mjcf_of(text: str, path: str | Path) -> Arm:
    """``read_mjcf`` of a text; ``path`` names it in errors, and what it includes is looked for beside it."""
    return read_reading(path, tip=None, content=text.encode()).arm


def read_reading(path: str | Path, *, tip: str | None, content: bytes | None = None) -> Reading:
    """As ``read_all``, with MuJoCo's own compiler for what is not read here. InputError: nested too deeply."""
    try:
        return read_all(path, tip=tip, content=content)
    except RecursionError:
        raise InputError(path, "its bodies are nested too deeply to be an arm's") from None
    except NeedsCompiler as needed:
        return read_all(path, tip=tip, content=compiled_text(Path(path), needed, content))


def read_all(path: str | Path, *, tip: str | None, content: bytes | None = None) -> Reading:
    """As ``read_mjcf``, with the places of the numbers; ``content``: see ``read_tree``.

    NeedsCompiler where the numbers do not stand in the file; InputError where no joint moves.
    """
    tree = read_tree(path, content)
    _check_compiler(tree)
    chain = _chain(tree, tip)
    joints: list[Joint] = []
    found: list[tuple[Node, Attributes]] = []
    bodies: list[Body] = []
    pose: Array = np.eye(4)
    childclass: str | None = None
    for number, node in enumerate(chain):
        pose = pose @ tree.pose(node.element.attributes)
        childclass = node.element.attributes.get("childclass", childclass)
        for element in _joints_of(tree, node):
            given = tree.attributes(element, childclass)
            anchor = np.eye(4)
            anchor[:3, 3] = tree.numbers(given, "pos", "0 0 0", 3)
            joints.append(_joint(tree, element, given, pose @ anchor))
            found.append((element, given))
            pose = np.asarray(np.linalg.inv(anchor), float)
        after = chain[number + 1] if number + 1 < len(chain) else None
        bodies += _merged(tree, node, len(joints) - 1, pose, childclass, after)
    if not joints:
        raise InputError(tree.path, "has no moving joint")
    check_names(tree.path, joints)
    option = {
        name: value for one in tree.sections if one.tag == "option" for name, value in one.element.attributes.items()
    }
    gravity = np.zeros(3) if "gravity" in tree.disabled else tree.numbers(option, "gravity", "0 0 -9.81", 3)
    arm = Arm(
        name=tree.text.root.attributes.get("model", "robot"),
        joints=tuple(_with_bodies(joint, k, bodies) for k, joint in enumerate(joints)),
        gravity=(float(gravity[0]), float(gravity[1]), float(gravity[2])),
        tool=tuple(tuple(float(value) for value in row) for row in pose),  # type: ignore[arg-type]
    )
    return Reading(tree, arm, tuple(found), tuple(one for one in bodies if one.link >= 0), chain[-1].name)


def _chain(tree: Tree, tip: str | None) -> list[Node]:
    """The bodies from the world to ``tip``, else to the end of the arm: ``joints_of_arm``.

    Behind the last joint along what is fixed to it, as far as it is one body; of a hand, to the body of its fingers.
    """
    ways = [way for body in tree.all("worldbody") if body.tag == "body" for way in _ways(body)]
    if tip is not None:
        for way in ways:
            for place, body in enumerate(way, 1):
                if body.name == tip:
                    return way[:place]
        raise InputError(tree.path, f"no body {tip!r}")
    ways = _driven(tree, ways)
    chains = [[id(joint) for body in way for joint in _moving(body)] for way in ways]
    count = joints_of_arm(chains)
    moving = ends_that_move(chains)
    if not moving:
        raise InputError(tree.path, "has no moving joint")
    if count is None:
        names = ", ".join(ways[index][-1].name for index in moving)
        raise InputError(
            tree.path, f"branches into {names}; name the tip: armscope model FILE --tip BODY --out ARM.toml"
        )
    arm = chains[moving[0]][:count]
    hand = [way for way, chain in zip(ways, chains) if chain[:count] == arm and len(chain) > count]
    shared = hand or [way for way, chain in zip(ways, chains) if chain == arm]
    return [bodies[0] for bodies in zip(*shared) if all(one is bodies[0] for one in bodies)]


def _ways(body: Node) -> Iterator[list[Node]]:
    """Per end of the tree below a body, the bodies on the way to it, with both ends."""
    below = body.all("body")
    if not below:
        yield [body]
    for one in below:
        for way in _ways(one):
            yield [body, *way]


def _moving(body: Node) -> list[Node]:
    return [*body.all("joint"), *body.all("freejoint")]


def _driven(tree: Tree, ways: list[list[Node]]) -> list[list[Node]]:
    """Of the trees of a scene those with a joint that an actuator drives, if there is one; else all."""
    driven = {one.element.attributes.get("joint") for one in tree.all("actuator")}
    trees = {id(way[0]) for way in ways for body in way for joint in body.all("joint") if joint.name in driven}
    return [way for way in ways if id(way[0]) in trees] or ways


def _joints_of(tree: Tree, body: Node) -> list[Node]:
    if body.all("freejoint"):
        raise InputError(tree.path, f"body {body.name!r} is free; an arm must stand on the world")
    return body.all("joint")


def _check_compiler(tree: Tree) -> None:
    for name in _SCALING:
        if float(tree.numbers(tree.compiler, name, "0", 1)[0]) > 0:
            raise NeedsCompiler(tree.path, f"has <compiler {name}>")


def _merged(
    tree: Tree, node: Node, link: int, pose: Array, childclass: str | None, after: Node | None, moves: bool = False
) -> Iterator[Body]:
    """A body and what hangs on it, but for the next of the chain; what moves, in the pose of the file."""
    yield Body(link, node, pose, _inertial(tree, node, childclass), childclass, moves)
    for child in node.all("body"):
        if child is not after:
            inner = child.element.attributes.get("childclass", childclass)
            here = pose @ tree.pose(child.element.attributes)
            yield from _merged(tree, child, link, here, inner, after, moves or bool(_moving(child)))


def _inertial(tree: Tree, body: Node, childclass: str | None) -> Array:
    """(10,) barycentric parameters in the body's frame."""
    inertials = body.all("inertial")
    from_geoms = tree.compiler.get("inertiafromgeom", "auto")
    if from_geoms == "true" or (from_geoms == "auto" and not inertials):
        low, high = tree.numbers(tree.compiler, "inertiagrouprange", "0 5", 2)
        total = np.zeros(10)
        for geom in body.all("geom"):
            given = tree.attributes(geom, childclass)
            if low <= float(tree.numbers(given, "group", "0", 1)[0]) <= high:
                total = total + geom_inertia(tree, body.name, given)
        return total
    if not inertials:
        return np.zeros(10)
    given = inertials[0].element.attributes
    mass = float(tree.numbers(given, "mass", "0", 1)[0])
    if "fullinertia" in given:
        xx, yy, zz, xy, xz, yz = (float(v) for v in tree.numbers(given, "fullinertia", "", 6))
    else:
        xx, yy, zz = (float(v) for v in tree.numbers(given, "diaginertia", "0 0 0", 3))
        xy = xz = yz = 0.0
    if problem := unphysical(mass, (xx, yy, zz, xy, yz, xz)):
        raise InputError(tree.path, f"body {body.name!r}: {problem}")
    return transform(barycentric(mass, (0.0, 0.0, 0.0), (xx, yy, zz, xy, yz, xz)), tree.pose(given))


def _joint(tree: Tree, node: Node, given: Attributes, origin: Array) -> Joint:
    kind = given.get("type", "hinge")
    if kind not in _TYPES:
        raise InputError(tree.path, f"joint {node.name!r} is of type {kind!r}; expected hinge or slide")
    for name in ("stiffness", "springdamper"):
        if any(float(part) != 0.0 for part in given.get(name, "0").split()):
            raise InputError(tree.path, f"joint {node.name!r} has a spring ({name}), which is not read; remove it")
    unit = tree.angle if kind == "hinge" else 1.0
    axis = tree.numbers(given, "axis", "0 0 1", 3)
    if np.linalg.norm(axis) < 1e-9:
        raise InputError(tree.path, f"joint {node.name!r}: axis needs a direction, is zero")
    axis = axis / np.linalg.norm(axis)
    reference = unit * float(tree.numbers(given, "ref", "0", 1)[0])
    back = np.eye(4)
    if kind == "hinge":
        back[:3, :3] = about(axis, -reference)
    else:
        back[:3, 3] = -reference * axis
    pose = origin @ back
    friction, armature = (float(tree.numbers(given, name, "0", 1)[0]) for name in ("frictionloss", "armature"))
    damping = _damping(tree, node, given)
    force = np.abs(tree.numbers(given, "actuatorfrcrange", "0 0", 2)).max()
    return Joint(
        name=node.name,
        type=_TYPES[kind],  # type: ignore[arg-type]
        convention="placed",
        xyz=(float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3])),
        rpy=rpy_of(pose),
        axis=(float(axis[0]), float(axis[1]), float(axis[2])),
        limits=_range(tree, given, unit),
        torque_limit=float(force) or None,
        rotor_inertia=armature,
        viscous=(damping, damping),
        coulomb=(friction, friction),
    )


def _damping(tree: Tree, node: Node, given: Attributes) -> float:
    """N m s/rad (N s/m). InputError where it is more than linear in the speed: MuJoCo 4 has polynomials."""
    text = given.get("damping", "0")
    linear, *higher = tree.numbers(given, "damping", "0", max(1, len(text.split())))
    if any(higher):
        advice = "only the first number, linear in the speed, is read; remove the others"
        raise InputError(tree.path, f"joint {node.name!r} has damping={text!r}: {advice}")
    return float(linear)


def _range(tree: Tree, given: Attributes, unit: float) -> tuple[float, float] | None:
    """rad or m; None where the joint is not limited."""
    automatic = tree.compiler.get("autolimits", "true") == "true" and "range" in given
    limited = given.get("limited", "auto")
    if limited == "false" or (limited == "auto" and not automatic):
        return None
    low, high = (unit * float(value) for value in tree.numbers(given, "range", "0 0", 2))
    return (low, high) if low < high else None


def _with_bodies(joint: Joint, link: int, bodies: list[Body]) -> Joint:
    """The joint with the masses of the bodies of its link."""
    total = np.zeros(10)
    for one in bodies:
        if one.link == link:
            total = total + transform(one.parameters, one.pose)
    mass, com, inertia = about_com(total)
    x, y, z, xy, yz, xz = inertia
    return replace(joint, mass=mass, com=com, inertia=(x, y, z, xy, yz, xz))
