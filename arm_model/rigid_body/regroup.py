"""Inertial parameters moved inwards through the joints that do not see them: the same torques from fewer numbers.

A revolute joint turns about z: what is symmetric about its axis and has no moment of inertia about it (mass, mz, and
Iyy taken from both Ixx and Iyy) acts on the links before it only. A prismatic joint never turns: all moments of inertia
do. Khalil and Dombre, "Modeling, identification and control of robots", 2002, section 9.4. What reaches the base is
dropped.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.rigid_body.inertia import transform
from arm_model.rigid_body.newton_euler import Chain

_MASS, _MZ, _IXX, _IYY = 0, 3, 4, 7


def regrouped(chain: Chain, bodies: Array) -> Array:
    """(..., n, 10) bodies in joint frames -> the same arm's with fewer entries that differ from zero."""
    bodies = np.array(bodies, float)
    for j in reversed(range(len(chain))):
        of_joint = bodies[..., j, :]
        moved = np.zeros_like(of_joint)
        if chain.revolute[j]:
            moved[..., [_MASS, _MZ, _IYY]] = of_joint[..., [_MASS, _MZ, _IYY]]
            moved[..., _IXX] = of_joint[..., _IYY]
        else:
            moved[..., 4:] = of_joint[..., 4:]
        of_joint -= moved
        if j:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = chain.rotation[j], chain.shift[j]
            bodies[..., j - 1, :] += transform(moved, pose)
    # rounding leaves tiny numbers where a structural zero belongs, and each costs operations
    scale = np.abs(bodies).max(axis=tuple(range(bodies.ndim - 1)), keepdims=True).max(initial=1e-30)
    return np.where(np.abs(bodies) < 1e-14 * scale, 0.0, bodies)
