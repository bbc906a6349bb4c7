"""What the equations of an arm must agree with: accelerations under given forces, energy and momentum.

Shapes as in ``arm_model.rigid_body.numeric`` and ``arm_model.moving_base.numeric``, whose functions they are made of.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.moving_base.numeric import BaseRows, forces_with_base, mass_matrix_with_base, rotations
from arm_model.moving_base.recursion import DOF
from arm_model.rigid_body import hydrodynamics
from arm_model.rigid_body.kinematics import link_frames
from arm_model.rigid_body.numeric import drive_mass_matrix, mass_matrix, samples
from arm_model.rigid_body.regressor import link_parameters
from arm_model.system.dynamics import inverse_dynamics


def forward_dynamics(arm: Arm, q: Array, qd: Array, tau: Array) -> Array:
    """(N, n) accelerations under joint torques ``tau``."""
    q, qd, tau = samples(arm, q, qd, tau)
    bias = inverse_dynamics(arm, q, qd, np.zeros_like(q))
    return np.asarray(np.linalg.solve(drive_mass_matrix(arm, q), (tau - bias)[..., None])[..., 0], float)


def energy_of(arm: Arm, q: Array, qd: Array) -> Array:
    """(N,) J: kinetic (links, rotors, added mass) plus potential energy (weight and buoyancy).

    The potential is zero at the origin of the base frame.
    """
    q, qd = samples(arm, q, qd)
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", qd, mass_matrix(arm, q), qd)
    frames = link_frames(arm, q)[:, 1:]
    parameters = link_parameters(arm)
    first, mass = parameters[:, 1:4].copy(), parameters[:, :1].copy()
    for j, joint in enumerate(arm.joints):
        if joint.cylinder is not None:  # displaced water falls where the link rises
            displaced = hydrodynamics.water_of(joint.cylinder).displaced
            mass[j] -= displaced
            first[j] -= displaced * np.add(joint.cylinder.start, joint.cylinder.end) / 2
    moment = np.einsum("nkij,kj->nki", frames[..., :3, :3], first) + mass * frames[..., :3, 3]
    return kinetic - moment.sum(axis=1) @ np.array(arm.gravity)


def accelerations_with_base(arm: Arm, base: BaseRows, q: Array, qd: Array, forces: Array) -> Array:
    """(N, 6 + n) rates of (velocity, qd) under ``forces`` (N, 6 + n), with rotors, without friction of the drives."""
    bias = forces_with_base(arm, replace(base, rate=None), q, qd, np.zeros_like(qd))
    matrix = mass_matrix_with_base(arm, q)
    matrix[:, DOF:, DOF:] += np.diag(arm.joint_array("ratio") ** 2 * arm.joint_array("rotor_inertia"))
    return np.asarray(np.linalg.solve(matrix, (np.asarray(forces, float) - bias)[..., None])[..., 0], float)


def momentum_of(arm: Arm, position: Array, base: BaseRows, q: Array, qd: Array) -> Array:
    """(N, 6) linear (N s) and angular momentum (N m s) about the world's origin, world frame, with all added mass.

    position (N, 3) m of the body frame's origin in the world.
    """
    q, qd = samples(arm, q, qd)
    rates = np.concatenate([np.asarray(base.velocity, float), qd], axis=-1)
    body = np.einsum("nij,nj->ni", mass_matrix_with_base(arm, q)[:, :DOF], rates)
    turn = rotations(base.attitude)
    linear, angular = (np.einsum("nij,nj->ni", turn, part) for part in (body[:, :3], body[:, 3:]))
    return np.concatenate([linear, angular + np.cross(position, linear)], axis=-1)
