"""A calibrated arm in Denavit-Hartenberg parameters with its joints placed again, as the URDF file has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.rigid_body import link_frames, placement
from arm_model.rigid_body.inertia import about_com, barycentric, transform
from identification.kinematics.models.chain import xyz_ypr
from identification.kinematics.models.denavit_hartenberg import in_denavit_hartenberg
from identification.kinematics.models.parameters import as_pose

FARTHEST = 0.3
"""rad: an axis that a calibration turns by more is that of another arm."""


def placed_as(arm: Arm, original: Arm) -> Arm:
    """The same motion as ``arm``, which is in D-H, with the link frames as near as can be to those of ``original``.

    original: joints placed as in URDF, from which ``arm`` was made (``in_denavit_hartenberg``) and then calibrated. A
    frame moves with its D-H frame; what would put its origin off the joint's axis, or turn it away from it, is taken
    back. What that is at the last link stands in ``tool``. Mass distributions keep their place in the link.
    InputError where an axis points elsewhere than in ``original``, by more than ``FARTHEST``.
    """
    rest = np.zeros(len(arm))
    nominal, _ = in_denavit_hartenberg(original)
    old, table, now = (link_frames(one, rest) for one in (original, nominal, arm))
    frames, joints, link = [np.array(original.base)], list[Joint](), np.eye(4)
    for j, (joint, was) in enumerate(zip(arm.joints, original.joints)):
        moved = np.linalg.inv(table[j + 1]) @ old[j + 1]
        line = now[j] @ placement(joint)[0]
        link = now[j + 1] @ moved
        frames.append(_on_axis(link, np.array(was.axis), line, was))
        joints.append(_placed(joint, was, np.linalg.inv(frames[-2]) @ frames[-1], np.linalg.inv(moved)))
    tool = np.linalg.inv(frames[-1]) @ link @ np.array(original.tool)
    return replace(arm, joints=tuple(joints), base=original.base, tool=as_pose(tool))


def _on_axis(link: Array, axis: Array, line: Array, joint: Joint) -> Array:
    """The frame nearest to ``link`` whose ``axis`` (3,), in its own coordinates, is the z axis of ``line``."""
    direction, has = line[:3, 2], link[:3, :3] @ axis
    turn = np.cross(has, direction)
    angle = float(np.arctan2(np.linalg.norm(turn), has @ direction))
    if angle > FARTHEST:
        raise InputError(
            f"joint {joint.name!r}",
            f"its axis is {angle:.2g} rad off that of the URDF file: the model is of another arm",
        )
    frame = link.copy()
    if angle > 0:
        frame[:3, :3] = Rotation.from_rotvec(turn / np.linalg.norm(turn) * angle).as_matrix() @ link[:3, :3]
    if joint.revolute:
        frame[:3, 3] = line[:3, 3] + direction * (direction @ (link[:3, 3] - line[:3, 3]))
    return frame


def _placed(joint: Joint, was: Joint, pose: Array, back: Array) -> Joint:
    """The joint at a pose (4, 4) in the frame before; ``back`` (4, 4): of its D-H frame in its own."""
    turn = np.eye(4)
    turn[:3, :3] = back[:3, :3]
    _, _, (xx, yy, zz, xy, yz, xz) = about_com(transform(barycentric(joint.mass, (0.0, 0.0, 0.0), joint.inertia), turn))
    x, y, z, yaw, pitch, roll = (float(v) for v in xyz_ypr(pose))
    cx, cy, cz = (back[:3, :3] @ joint.com + back[:3, 3]).tolist()
    return replace(
        joint,
        convention="placed",
        theta=0.0,
        d=0.0,
        a=0.0,
        alpha=0.0,
        beta=0.0,
        xyz=(x, y, z),
        rpy=(roll, pitch, yaw),
        axis=was.axis,
        com=(cx, cy, cz),
        inertia=(xx, yy, zz, xy, yz, xz),
    )
