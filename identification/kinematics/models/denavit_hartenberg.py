"""Denavit-Hartenberg parameters of an arm whose joints are placed as in URDF, so that it can be calibrated.

By the product of exponentials: axes and end frame at rest say all of the kinematics. The frames of the links then lie
elsewhere in them, and with them masses, inertias, the tool and the tracked target are carried over: motion, torques and
tracked points stay what they were.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.rigid_body import link_frames, placement
from arm_model.rigid_body.inertia import about_com, barycentric, transform
from identification.kinematics.models.hayati import to_hayati
from identification.kinematics.models.parameters import as_pose
from identification.kinematics.models.product_of_exponentials import Exponentials


def in_denavit_hartenberg(arm: Arm) -> tuple[Arm, Array]:
    """The same arm in D-H (Hayati for parallel axes), and (4, 4) the pose of its old last link in the new frame.

    An arm that is in D-H already is returned unchanged, with the identity.
    """
    if all(joint.convention != "placed" for joint in arm.joints):
        return arm, np.eye(4)
    old = link_frames(arm, np.zeros(len(arm)))
    table = to_hayati(_exponentials(arm, old))
    bare = [_in_row(joint, row) for joint, row in zip(arm.joints, table.rows)]
    frame = Arm(name=arm.name, joints=tuple(bare), base=as_pose(table.base))
    new = link_frames(frame, np.zeros(len(arm)))
    moved = [np.linalg.inv(n) @ o for n, o in zip(new[1:], old[1:])]  # pose of every old link frame in the new one
    joints = tuple(_carried(joint, now, pose) for joint, now, pose in zip(arm.joints, bare, moved))
    return replace(arm, joints=joints, base=frame.base, tool=as_pose(moved[-1] @ np.array(arm.tool))), moved[-1]


def _in_row(joint: Joint, row: Array) -> Joint:
    """A joint of the same type at theta, d, a, alpha, beta (5,)."""
    theta, d, a, alpha, beta = (float(v) for v in row)
    return Joint(type=joint.type, theta=theta, d=d, a=a, alpha=alpha, beta=beta)


def _exponentials(arm: Arm, frames: Array) -> Exponentials:
    """Screws of the joint axes at rest, and the last link's frame."""
    screws = []
    for joint, before in zip(arm.joints, frames):
        axis = before @ placement(joint)[0]
        w, p = axis[:3, 2], axis[:3, 3]
        screws.append(np.concatenate((w, -np.cross(w, p)) if joint.revolute else (np.zeros(3), w)))
    return Exponentials(np.array(screws), frames[-1])


def _carried(joint: Joint, now: Joint, pose: Array) -> Joint:
    """The joint where ``now`` puts it, its mass distribution seen from the new link frame."""
    # inertia is about the com, and only turns: by way of the origin rounding would make that of a mass point negative
    turn = np.eye(4)
    turn[:3, :3] = pose[:3, :3]
    _, _, (xx, yy, zz, xy, yz, xz) = about_com(transform(barycentric(joint.mass, (0.0, 0.0, 0.0), joint.inertia), turn))
    x, y, z = (pose[:3, :3] @ joint.com + pose[:3, 3]).tolist()
    return replace(
        joint,
        convention="standard",
        theta=now.theta,
        d=now.d,
        a=now.a,
        alpha=now.alpha,
        beta=now.beta,
        xyz=(0.0, 0.0, 0.0),
        rpy=(0.0, 0.0, 0.0),
        axis=(0.0, 0.0, 1.0),
        com=(x, y, z),
        inertia=(xx, yy, zz, xy, yz, xz),
    )
