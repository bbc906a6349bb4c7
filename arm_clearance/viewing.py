"""An arm as viewers take it: its links with their capsules as URDF, and where each is relative to the link before."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from arm_clearance.chain import Body, Chain
from arm_io.types import Array


def link_names(chain: Chain) -> list[str]:
    """Names of the frames: base, link1, .., tool. A link's frame is on the axis of the joint that moves it."""
    return ["base", *(f"link{number}" for number in range(1, len(chain) + 1)), "tool"]


def relative_poses(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Translations (k, n + 1, 3) m and quaternions (k, n + 1, 4), x y z w, of each frame in the one before.

    q  (k, n) rad (m), as the controller reports it
    """
    # here: every command that opens a recording imports this module, and scipy takes as long as all of them
    from scipy.spatial.transform import Rotation

    angles = q @ chain.coupling.T
    shifts, turns = np.empty((len(q), len(chain) + 1, 3)), np.empty((len(q), len(chain) + 1, 4))
    for joint, (pose, sliding) in enumerate(zip(_origins(chain), chain.sliding)):
        rotation = Rotation.from_matrix(pose[:3, :3])
        shifts[:, joint] = pose[:3, 3]
        if sliding:
            shifts[:, joint] += angles[:, joint : joint + 1] * pose[:3, 2]
            turns[:, joint] = rotation.as_quat()
        else:
            turns[:, joint] = (
                rotation * Rotation.from_rotvec(angles[:, joint : joint + 1] * [0.0, 0.0, 1.0])
            ).as_quat()
    shifts[:, -1] = chain.after[-1][:3, :3] @ chain.tool + chain.after[-1][:3, 3]
    turns[:, -1] = Rotation.from_matrix(chain.after[-1][:3, :3]).as_quat()
    return shifts, turns


def viewer_urdf(chain: Chain, joints: Sequence[str]) -> str:
    """URDF with the frames of ``relative_poses`` at q = 0, the names of the joints, and each capsule as a visual.

    Masses and the coupling of joints are not in it: it is for looking at, beside the transforms.
    """
    robot = ElementTree.Element("robot", name="arm")
    names, after = link_names(chain), [np.eye(4), *chain.after]
    for number, link in enumerate(names):
        element = ElementTree.SubElement(robot, "link", name=link)
        for body in (one for one in chain.bodies if one.link == number):
            _visual(element, body, chain.base if number == 0 else after[number])
    poses = [*_origins(chain), _pose(np.eye(3), chain.after[-1][:3, :3] @ chain.tool + chain.after[-1][:3, 3])]
    poses[-1][:3, :3] = chain.after[-1][:3, :3]
    for number, pose in enumerate(poses):
        moving = number < len(chain)
        kind = "fixed" if not moving else "prismatic" if chain.sliding[number] else "revolute"
        title = joints[number] if moving else "flange"
        element = ElementTree.SubElement(robot, "joint", name=title, type=kind)
        ElementTree.SubElement(element, "parent", link=names[number])
        ElementTree.SubElement(element, "child", link=names[number + 1])
        ElementTree.SubElement(element, "origin", _origin(pose))
        if moving:
            low, high = (repr(float(value)) for value in chain.limits[number])
            ElementTree.SubElement(element, "axis", xyz="0 0 1")
            ElementTree.SubElement(element, "limit", lower=low, upper=high, effort="0", velocity="0")
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def _origins(chain: Chain) -> list[Array]:
    """(4, 4) of each joint's axis frame in the frame before, at q = 0."""
    return [before @ pose for before, pose in zip([chain.base, *chain.after[:-1]], chain.before)]


def _visual(link: ElementTree.Element, body: Body, pose: Array) -> None:
    """A capsule as a cylinder and two spheres; ``pose``: of the link's own frame in the one of the viewer."""
    from scipy.spatial.transform import Rotation

    start, end = (pose[:3, :3] @ point + pose[:3, 3] for point in (body.start, body.end))
    length = float(np.linalg.norm(end - start))
    for point in (start, end):
        _shape(link, "sphere", _pose(np.eye(3), point), radius=body.radius)
    if length > 1e-6:
        turned, _ = Rotation.align_vectors([(end - start) / length], [[0.0, 0.0, 1.0]])
        _shape(link, "cylinder", _pose(turned.as_matrix(), (start + end) / 2), radius=body.radius, length=length)


def _shape(link: ElementTree.Element, tag: str, pose: Array, **sizes: float) -> None:
    visual = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(visual, "origin", _origin(pose))
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(geometry, tag, {name: repr(float(size)) for name, size in sizes.items()})
    material = ElementTree.SubElement(visual, "material", name="armscope")
    ElementTree.SubElement(material, "color", rgba="0.85 0.5 0.15 1")


def _origin(pose: Array) -> dict[str, str]:
    r = pose[:3, :3]
    level = float(np.hypot(r[0, 0], r[1, 0]))
    if level > 1e-9:
        roll, yaw = np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0])
    else:  # the axis of roll is that of yaw
        roll, yaw = np.arctan2(-r[1, 2], r[1, 1]), 0.0
    rpy = [float(angle) for angle in (roll, np.arctan2(-r[2, 0], level), yaw)]
    return {"xyz": " ".join(map(repr, pose[:3, 3].tolist())), "rpy": " ".join(map(repr, rpy))}


def _pose(rotation: Array, translation: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose
