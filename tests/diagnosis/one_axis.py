"""A joint about a vertical axis with rotor and friction; currents by the law of a model file, without the engine."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.rigid_body.numeric import rigid_torque


def vertical_joint(rotor: float, coulomb: float, viscous: float, smoothing: float) -> Joint:
    """kg m2, N m, N m s/rad and rad/s; a gear and a torque constant of 1."""
    return Joint(
        convention="placed",
        axis=(0.0, 0.0, 1.0),
        xyz=(0.0, 0.0, 0.0),
        rpy=(0.0, 0.0, 0.0),
        gear=1.0,
        torque_constant=1.0,
        rotor_inertia=rotor,
        coulomb=(coulomb, coulomb),
        viscous=(viscous, viscous),
        sign_velocity=smoothing,
    )


FREE = Arm("free", (vertical_joint(0.0, 0.0, 0.0, 0.01),))
"""Without masses and friction."""


def currents(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """(m, J) A that an arm without effects needs: rigid links, rotors, and friction at the motors by direction."""
    torque = rigid_torque(arm, q, qd, qdd)
    for j, joint in enumerate(arm.joints):
        smooth = qd[:, j] / np.hypot(qd[:, j], joint.sign_velocity)
        dry = np.where(qd[:, j] > 0, joint.coulomb[0], joint.coulomb[1])
        wet = np.where(qd[:, j] > 0, joint.viscous[0], joint.viscous[1])
        torque[:, j] += joint.ratio**2 * (joint.rotor_inertia * qdd[:, j] + wet * qd[:, j]) + joint.ratio * dry * smooth
    return np.asarray(torque / arm.joint_array("drive_constant"))


def built_up(v: Array, coulomb: float, stiffness: float, rate: float) -> Array:
    """(k,) N m: friction by Dahl's law without damping at speeds v (k,) rad/s, ``rate`` rows/s, exactly row by row.

    coulomb N m, stiffness N m/rad: torque over the way since a reversal.
    """
    torque, now = np.empty_like(v), 0.0
    for k, way in enumerate(((v + np.roll(v, 1)) / 2 / rate).tolist()):
        level = coulomb if way > 0.0 else -coulomb
        torque[k] = now = level + (now - level) * np.exp(-stiffness * abs(way) / coulomb)
    return torque
