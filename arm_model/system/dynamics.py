"""Torques of an arm with its drives and effects, of N samples at once.

    M(q) q'' + h(q, q') + g(q) + Jr q'' + friction(q') = tau                       (joint side, N m; N)

M, h, g from ``arm_model.rigid_body.newton_euler``; Jr reflected rotor inertia; friction as in
``arm_model.rigid_body.numeric.drive_torque``. Shapes: q, qd, qdd, tau (N, n) rad, rad/s, rad/s2, N m (m and N for
prismatic joints).
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body.numeric import drive_torque, samples
from arm_model.system.along_motion import rigid_torque_along
from arm_model.system.inverse import torque_with_effects


def inverse_dynamics(arm: Arm, q: Array, qd: Array, qdd: Array, *, time: Array | float = 0.0) -> Array:
    """(N, n) joint torque that the motors give, abs(gear) k i: rigid links, reflected rotors, friction, effects.

    With effects or coupled joints q, qd, qdd are of the motors over their gear ratios; ``time`` (N,) s matters for
    drifting friction only. Of the effects everything algebraic acts; elastic transmissions count as rigid and bristles
    as sliding, since what their states were cannot be determined from one sample.
    """
    q, qd, qdd = samples(arm, q, qd, qdd)
    if arm.effects or arm.coupling:
        return torque_with_effects(arm, q, qd, qdd, np.broadcast_to(np.asarray(time, float), q.shape[:1]))
    drives = [drive_torque(joint, qd[:, j], qdd[:, j]) for j, joint in enumerate(arm.joints)]
    return rigid_torque_along(arm, q, qd, qdd) + np.stack(drives, axis=-1)
