"""An arm as MuJoCo has it, for its inverse dynamics to be compared with ours; on a free joint where its base floats."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body import kinematics


def mujoco_model(arm: Arm) -> Any:
    """A compiled ``mujoco.MjModel`` of the rigid bodies: no friction, no drives, no water."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.gravity = arm.gravity
    body = spec.worldbody
    if (base := arm.floating) is not None:
        body = body.add_body()
        body.add_freejoint()
        _weigh(body, base.mass, np.array(base.com), tensor_of(base.inertia))
    # A body for what stands before the joint, with the joint in it; the inertia sits behind `after`.
    pose = np.array(arm.base)
    for joint in arm.joints:
        before, after = kinematics.placement(joint)
        pose = pose @ before
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, pose[:3, :3].ravel())
        body = body.add_body(pos=pose[:3, 3], quat=quaternion)
        kind = mujoco.mjtJoint.mjJNT_HINGE if joint.revolute else mujoco.mjtJoint.mjJNT_SLIDE
        body.add_joint(type=kind, axis=[0, 0, 1])
        tensor = after[:3, :3] @ tensor_of(joint.inertia) @ after[:3, :3].T
        _weigh(body, joint.mass, after[:3, :3] @ joint.com + after[:3, 3], tensor)
        pose = after
    return spec.compile()


def tensor_of(inertia: tuple[float, ...]) -> Array:
    """(3, 3) of xx, yy, zz, xy, yz, xz."""
    xx, yy, zz, xy, yz, xz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _weigh(body: Any, mass: float, com: Array, tensor: Array) -> None:
    body.mass, body.ipos, body.explicitinertial = mass, com, True
    body.fullinertia = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
