"""How the weight of a link lies to every joint, whatever its mass: what sag follows where no masses are known.

The torque that holds joint j against gravity is a sum over the links k behind it of

    tau_jk = -z_j . (R_k s_k x g),    s_k = m_k c_k and what the links behind it add about its end,

with the first moment s_k (kg m) in the frame of link k (Gautier and Khalil, IEEE T-RA 1990: what lies along the axis
of joint k counts with the link before). So per joint and link two numbers say how it sags.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body.kinematics import link_frames, placement


def gravity_levels(arm: Arm, q: Array, link: int) -> Array:
    """(R, n, 2) holding torque of every joint per kg m of first moment and m/s2 of gravity, -1 .. 1, at q (R, n).

    Of ``link`` (from 1), with its first moment along the link's x axis (made perpendicular to the axis of its joint,
    as it is in D-H), and along the axis times that. 0 for joints behind the link, and for prismatic ones.
    """
    frames = link_frames(arm, q)[:, 1:, :3, :3]
    axes = np.array([placement(joint)[1][2, :3] for joint in arm.joints])  # of joint k, in link frame k
    levels = np.zeros((len(q), len(arm), 2))
    down = np.array(arm.gravity) / max(float(np.linalg.norm(arm.gravity)), 1e-300)
    for column, arm_of_weight in enumerate(_across(axes[link - 1])):
        moment = np.cross(frames[:, link - 1] @ arm_of_weight, down)
        for j, joint in enumerate(arm.joints[:link]):
            if joint.revolute:
                levels[:, j, column] = -np.einsum("ni,ni->n", frames[:, j] @ axes[j], moment)
    return levels


def _across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors perpendicular to a unit vector (3,): the x axis as far as it is, and axis times that."""
    x = np.eye(3)[0] if abs(axis[0]) < 0.9 else np.eye(3)[1]
    first = x - axis * (axis @ x)
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)
