"""Friction of a joint's own axis: bearings and seals between a link and the one before it.

    tau_q = B q' + F sign(q')                                         at the joint, against the motion of the link

The friction of a drive follows the motor instead. Where joints are coupled (q' = C m', ``Arm.coupling`` and the effect
``wrist_coupling``), the two differ: the motors bear C^T tau_q, so that a motor is loaded by the friction of every axis
that it turns. Without couplings both are the same function, and only their sum can be identified.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body import scalar

LINK_FRICTION = ("link_viscous", "link_coulomb")
"""Keys of a joint: N m s/rad (N s/m) and N m (N), at the joint."""


def unit_link_friction(arm: Arm, qd: Array) -> Array:
    """(N, n, f) torques on the links of unit coefficients, for speeds qd (N, n) of the links.

    One column per coefficient that the model has: viscous ones of all joints first, then Coulomb's.
    """
    sign = scalar.smooth_sign(qd, arm.joint_array("sign_velocity"))
    columns = [
        np.eye(len(arm))[j] * law
        for name, law in zip(LINK_FRICTION, (qd, sign))
        for j, joint in enumerate(arm.joints)
        if getattr(joint, name) is not None
    ]
    return np.stack(columns, axis=-1) if columns else np.zeros((*qd.shape, 0))


def link_friction(arm: Arm, qd: Array) -> Array | float:
    """(N, n) N m (N) on the links for speeds qd (N, n) of the links; 0.0 where the model has none."""
    values = [value for name in LINK_FRICTION for joint in arm.joints if (value := getattr(joint, name)) is not None]
    return np.asarray(unit_link_friction(arm, qd) @ np.array(values), float) if any(values) else 0.0
