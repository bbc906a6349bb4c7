"""URDF in: the kinematics, inertias, limits and joint friction of one serial chain.

See http://wiki.ros.org/urdf/XML.

Of the motors URDF knows the gears (``<mechanicalReduction>`` of a ``<transmission>``, as ros_control has it), but no
rotor inertias, torque constants and controllers: currents of an arm from URDF are torques at the joint, with a gear or
without. Friction and damping are at the joint.
"""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from arm_io import InputError, counted, read_file
from arm_io.plain_data import check_plain, is_number
from arm_io.toml import one_line
from arm_io.types import Array
from arm_model.assumed_capsules import assumed_capsules
from arm_model.branches import check_names
from arm_model.capsules import moved, of_geometry, round_points
from arm_model.description import Arm, Joint
from arm_model.meshes import mesh_file, vertices_of
from arm_model.rigid_body.inertia import about_com, barycentric, transform, unphysical
from arm_model.rigid_body.kinematics import roll_pitch_yaw, rpy_of
from arm_model.tables.fields import Pose
from arm_model.tables.link_shapes import Capsule
from arm_model.urdf.tree import Tree, link_at, robot_of

_MOVING = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
_LIMITS = ("lower", "upper")
UNKNOWN = 1e9
"""N m, N, rad/s, m/s or m: a limit of this size or above stands for none, where URDF requires a number."""
_SIZES = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
"""Shape of <collision> -> its attributes and how many numbers each has."""


def read_urdf(path: str | Path, *, tip: str | None = None) -> Arm:
    """The arm in a URDF file, from its root link to link ``tip`` (needed where several chains move: ``tip_of``).

    What is fixed to a link is merged into it, also beside the way to ``tip``; where ``tip`` is behind the last joint
    makes the tool. What moves beside that way, as the fingers of a hand, counts as fixed where the file places it
    (``urdf_gaps`` says so).
    InputError for anything that is not a serial chain of revolute, continuous and prismatic joints with physical links.
    """
    return urdf_of(read_file(path), path, tip=tip)


def urdf_of(text: str | bytes, path: str | Path, *, tip: str | None = None) -> Arm:
    """``read_urdf`` of a text; ``path`` names it in InputErrors, and is where meshes are looked for."""
    robot = robot_of(path, text)
    tree = Tree.of(path, robot)
    chain = tree.chain(tip)
    joints: list[Joint] = []
    gears = _gears(path, robot)
    offset = np.eye(4)  # of the next joint's parent in the last moving link's frame
    lump = np.zeros(10)
    first = next((number for number, joint in enumerate(chain, 1) if joint.get("type") != "fixed"), len(chain) + 1)
    bodies = [_body(path, tree, name, chain, number >= first) for number, name in enumerate(tree.names(chain))]
    shapes, lacking = [bodies[0].shape], [bodies[0].lacking]
    for element, body in zip(chain, bodies[1:]):
        pose = offset @ origin_of(path, element)
        inertial, shape = body.inertial, body.shape
        kind = element.get("type", "")
        if kind == "fixed":
            offset = pose
            lump = lump + transform(inertial, pose)
            shapes[-1] = _both(shapes[-1], moved(shape, pose))
            lacking[-1] |= body.lacking
            continue
        joints = _with_lump(path, joints, lump)
        joints.append(_joint(path, element, pose, gears.get(element.get("name", ""), 1.0)))
        shapes.append(shape)
        lacking.append(body.lacking)
        offset, lump = np.eye(4), inertial
    joints = _with_lump(path, joints, lump)
    if not joints:
        raise InputError(path, "has no moving joint")
    check_names(path, joints)
    bare = Arm(name=robot.get("name", "robot"), joints=tuple(joints), tool=_pose(offset))
    for number, assumed in enumerate(assumed_capsules(bare)):
        # what is fixed to a link whose own shape is not known does not take its place
        if lacking[number] and (known := shapes[number]) is not None:
            shapes[number] = (assumed, *known)
    shaped = tuple(replace(joint, capsule=shape) for joint, shape in zip(joints, shapes[1:]))
    return replace(bare, joints=shaped, capsule=shapes[0])


FURTHEST = 1e6
"""m, rad: no part of an arm is as far from another, or turned as often."""
FINE = -5
"""Power of ten, kg m2, of the last digit of inertias: files have as many digits, or more."""


def _rounding(tensor: xml.Element | None, names: Sequence[str]) -> float:
    """Half of the last digit of the entry that has most, kg m2; 0 beyond ``FINE``, where no file rounds."""
    texts = [] if tensor is None else [tensor.get(name, "0") for name in names]
    last = [number.as_tuple().exponent for text in texts if (number := Decimal(text.strip()))]
    least = min((int(exponent) for exponent in last), default=0)
    return 0.5 * 10.0**least if least <= FINE else 0.0


Capsules = tuple[Capsule, ...] | None
"""Of a link; None where the file does not say, or says it by a mesh whose file is missing."""


@dataclass(frozen=True)
class Body:
    """A link with all that hangs on it beside the chain.

    inertial  (10,) barycentric parameters in the link's frame; shape: capsules there
    lacking   whether the file of a mesh that its shape needs is missing
    """

    inertial: Array
    shape: Capsules
    lacking: bool


def _body(path: str | Path, tree: Tree, name: str, chain: Sequence[xml.Element], moves: bool) -> Body:
    """Of a link that is fixed to the root the inertia is 0: no torque depends on it, possible or not."""
    link = tree.links[name]
    inertial, shape = _inertial(path, link) if moves else np.zeros(10), _capsules(path, link)
    lacking = _unknown(shape, link)
    for joint in tree.beside(name, chain):
        pose = origin_of(path, joint)
        other = _body(path, tree, link_at(path, joint, "child"), chain, moves)
        inertial = inertial + transform(other.inertial, pose)
        shape = _both(shape, moved(other.shape, pose))
        lacking |= other.lacking
    return Body(inertial, shape, lacking)


def _capsules(path: str | Path, link: xml.Element) -> Capsules:
    """Capsules round the shapes of a link's <collision>; None where it has none, or the file of a mesh is missing."""
    found: list[Capsule] = []
    for collision in link.findall("collision"):
        geometry = collision.find("geometry")
        shape = None if geometry is None or not len(geometry) else geometry[0]
        if shape is not None and shape.tag == "mesh" and (file := mesh_file(Path(path), shape.get("filename", ""))):
            scale = np.array(numbers_of(path, shape, "scale", "1 1 1", 3))
            found.append(_round_mesh(file, tuple(scale.tolist()), origin_of(path, collision)))
            continue
        if shape is None or shape.tag not in _SIZES:
            return None
        sizes = [numbers_of(path, shape, name, "", count) for name, count in _SIZES[shape.tag].items()]
        if not all(size > 0 for size in sum(sizes, ())):
            raise InputError(path, f"link {link.get('name')!r}: the <{shape.tag}> of <collision> needs sizes above 0")
        found.append(of_geometry(shape.tag, sum(sizes, ()), origin_of(path, collision)))
    return tuple(found) or None


def _unknown(shape: Capsules, link: xml.Element) -> bool:
    """Whether a link has a <collision> of which nothing is known: the file of a mesh is missing."""
    return shape is None and link.find("collision") is not None


def _round_mesh(file: Path, scale: tuple[float, ...], pose: Array) -> Capsule:
    """The capsule round a mesh at ``pose`` (4, 4)."""
    capsules = moved((round_points(vertices_of(file) * scale),), pose)
    assert capsules is not None
    return capsules[0]


def _both(one: Capsules, other: Capsules) -> Capsules:
    """What is known of two links that are one."""
    return one if other is None else other if one is None else one + other


def _pose(matrix: Array) -> Pose:
    rows = [tuple(float(value) for value in row) for row in matrix]
    return rows[0], rows[1], rows[2], (0.0, 0.0, 0.0, 1.0)  # type: ignore[return-value]


def numbers_of(path: str | Path, element: xml.Element | None, name: str, default: str, count: int) -> tuple[float, ...]:
    """(count,) numbers of an attribute, else of ``default``; InputError where they are others."""
    text = default if element is None else element.get(name, default)
    try:
        values = tuple(float(part) for part in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        told = f"expected {counted(count, 'number')}"
        if "${" in text:
            told = "is an expression of xacro; expand the file first: xacro FILE > ARM.urdf"
        raise InputError(path, f"{name}={text!r}: {told}")
    if count == 3 and max(map(abs, values)) > FURTHEST:
        raise InputError(path, f"{name}={text!r}: is beyond {FURTHEST:g}; lengths are in m, angles in rad")
    check_plain(path, {name: list(values) if count > 1 else values[0]})
    return values


def origin_of(path: str | Path, element: xml.Element) -> Array:
    """(4, 4) pose of an element's <origin> in its parent; the identity without one."""
    origin = element.find("origin")
    roll, pitch, yaw = numbers_of(path, origin, "rpy", "0 0 0", 3)
    pose = roll_pitch_yaw((roll, pitch, yaw))
    pose[:3, 3] = numbers_of(path, origin, "xyz", "0 0 0", 3)
    return pose


def _inertial(path: str | Path, link: xml.Element) -> Array:
    """(10,) barycentric parameters in the link's frame; InputError where no body of any mass has its inertia.

    A link may have inertia without mass: simulators mark one that does not move like that, and frames are given some
    to satisfy a solver. Whether that is possible is a question of the whole that moves together (``_with_lump``); so
    is what only the digits of the file make impossible, such as 0 0 1e-6 of a fingertip.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return np.zeros(10)
    mass = numbers_of(path, inertial.find("mass"), "value", "0", 1)[0]
    tensor = inertial.find("inertia")
    names = ("ixx", "iyy", "izz", "ixy", "iyz", "ixz")
    entries = tuple(numbers_of(path, tensor, name, "0", 1)[0] for name in names)
    if problem := unphysical(mass or 1.0, entries, _rounding(tensor, names)):
        raise InputError(path, f"link {link.get('name')!r}: {problem}")
    return transform(barycentric(mass, (0.0, 0.0, 0.0), entries), origin_of(path, inertial))


def reductions(robot: xml.Element) -> dict[str, str]:
    """What the transmissions say of the gear, as it is written, of every joint that one of them names alone."""
    found = {}
    for transmission in robot.findall("transmission"):
        reduction = transmission.find(".//mechanicalReduction")
        driven = [joint.get("name", "") for joint in transmission.findall("joint")]
        if reduction is not None and len(driven) == 1:
            found[driven[0]] = (reduction.text or "").strip()
    return found


def _gears(path: str | Path, robot: xml.Element) -> dict[str, float]:
    """Motor angle over joint angle of every joint of which a number is stated; a word is none (``urdf_gaps``)."""
    gears = {joint: float(text) for joint, text in reductions(robot).items() if is_number(text)}
    for joint, gear in gears.items():
        if not np.isfinite(gear) or gear == 0.0:
            raise InputError(
                path, f"joint {joint!r}: mechanicalReduction is {gear:g}; expected a finite number other than 0"
            )
    return gears


def _joint(path: str | Path, element: xml.Element, pose: Array, gear: float) -> Joint:
    kind = element.get("type", "")
    if kind not in _MOVING:
        allowed = ", ".join([*_MOVING, "fixed"])
        raise InputError(path, f"joint {element.get('name')!r} is of type {kind!r}; expected one of {allowed}")
    limit, dynamics = element.find("limit"), element.find("dynamics")
    lower, upper = (numbers_of(path, limit, name, "0", 1)[0] for name in _LIMITS)
    effort = numbers_of(path, limit, "effort", "0", 1)[0]
    speed = numbers_of(path, limit, "velocity", "0", 1)[0]
    axis = numbers_of(path, element.find("axis"), "xyz", "1 0 0", 3)
    damping, friction = (numbers_of(path, dynamics, name, "0", 1)[0] for name in ("damping", "friction"))
    ratio = abs(gear)
    limited = kind != "continuous"
    wrong = _impossible(axis, (lower, upper) if limited else (0.0, 0.0), {"damping": damping, "friction": friction})
    if wrong:
        raise InputError(path, f"joint {element.get('name')!r}: {wrong}")
    try:
        return Joint(
            name=element.get("name", ""),
            type=_MOVING[kind],  # type: ignore[arg-type]
            convention="placed",
            xyz=(float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3])),
            rpy=rpy_of(pose),
            axis=(axis[0], axis[1], axis[2]),
            limits=(lower, upper) if limited and lower < upper and max(-lower, upper) < UNKNOWN else None,
            torque_limit=effort if 0 < effort < UNKNOWN else None,
            gear=gear,
            # so that torque at the joint = |gear| torque_constant i = i
            torque_constant=1.0 / ratio,
            motor_speed_limit=speed * ratio if 0 < speed < UNKNOWN else None,
            viscous=(damping / ratio**2, damping / ratio**2),
            coulomb=(friction / ratio, friction / ratio),
        )
    except ValidationError as error:
        raise InputError(path, f"joint {element.get('name')!r}: {one_line(error)}") from None


def _impossible(axis: Sequence[float], limits: tuple[float, float], dynamics: dict[str, float]) -> str | None:
    """What is impossible in a joint, or None: no axis, limits in the wrong order, friction that drives.

    Equal limits mean none: some programs must write limits.
    """
    if not any(axis):
        return "<axis xyz='0 0 0'> has no direction; expected a vector other than 0"
    if limits[0] > limits[1]:
        return f"<limit lower='{limits[0]:g}' upper='{limits[1]:g}'>: lower must be below upper"
    negative = next((name for name, value in dynamics.items() if value < 0), None)
    return negative and f"<dynamics {negative}='{dynamics[negative]:g}'> must not be negative"


def _with_lump(path: str | Path, joints: list[Joint], lump: Array) -> list[Joint]:
    """The last joint's link gets all that is fixed to it; what is fixed to the root does not move."""
    if not joints:
        return joints
    mass, com, inertia = about_com(lump)
    if problem := unphysical(mass, inertia):
        raise InputError(path, f"the link that joint {joints[-1].name!r} moves, with what is fixed to it: {problem}")
    x, y, z, xy, yz, xz = inertia
    return [*joints[:-1], replace(joints[-1], mass=mass, com=com, inertia=(x, y, z, xy, yz, xz))]
