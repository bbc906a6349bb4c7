"""The rigid links of an arm and their drives, vectorised over N samples with plain numpy: torques, mass matrix.

Shapes: q, qd, qdd, tau (N, n) rad, rad/s, rad/s2, N m (m and N for prismatic joints).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm, Joint
from arm_model.rigid_body import hydrodynamics, newton_euler, scalar
from arm_model.rigid_body.friction_curve import curve_level
from arm_model.rigid_body.inertia import barycentric, transform
from arm_model.rigid_body.link_friction import link_friction
from arm_model.tables.fields import Pose

BLOCK = 4096
"""Rows."""


def link_parameters(arm: Arm) -> Array:
    """(n, 10) barycentric inertial parameters of every link, in its link frame.

    Order: ``arm_model.rigid_body.inertia.PARAMETERS``.
    """
    return np.array([barycentric(joint.mass, joint.com, joint.inertia) for joint in arm.joints])


def bodies(arm: Arm) -> Array:
    """(n, 10) the same in the joint frames of ``newton_euler``."""
    return np.array(_bodies(arm.base, arm.joints))


@lru_cache(maxsize=32)  # every evaluation of the dynamics asks for it
def _bodies(base: Pose, joints: tuple[Joint, ...]) -> tuple[tuple[float, ...], ...]:
    links = newton_euler.chain_from(base, joints).link
    in_link = (barycentric(joint.mass, joint.com, joint.inertia) for joint in joints)
    return tuple(tuple(map(float, transform(p, pose))) for p, pose in zip(in_link, links))


def drive_torque(joint: Joint, qd: Any, qdd: Any) -> Any:
    """Joint torque that the drive itself takes: reflected rotor inertia, viscous and Coulomb friction, offset.

    Coulomb friction: with s = v / sqrt(v^2 + sign_velocity^2), (F+ + F-)/2 s + (F+ - F-)/2 s^2: F+ forwards, -F-
    backwards, nothing at rest. Viscous friction: (B+ + B-)/2 v + (B+ - B-)/2 |v|: B+ v forwards, B- v backwards. A
    friction curve adds to both (``arm_model.rigid_body.friction_curve``). ``qd`` and ``qdd`` are scalars of any kind,
    of the motor over the gear ratio.
    """
    ratio = joint.ratio
    forwards, backwards = (ratio**2 * viscous for viscous in joint.viscous)
    torque = ratio**2 * joint.rotor_inertia * qdd + (forwards + backwards) / 2 * qd
    if forwards != backwards:
        torque = torque + (forwards - backwards) / 2 * scalar.absolute(qd)
    sign = scalar.smooth_sign(qd, joint.sign_velocity)
    positive, negative = joint.coulomb
    mean, difference = ratio * (positive + negative) / 2, ratio * (positive - negative) / 2
    if joint.friction_curve is not None:
        torque = torque + sign * curve_level(joint.friction_curve, qd, sign)
    return torque + mean * sign + difference * sign * sign + ratio * joint.offset


def samples(arm: Arm, *arrays: Array) -> list[Array]:
    """The arrays as (N, n) float64; one sample (n,) becomes (1, n). InputError where the joints do not fit."""
    found = []
    for array in arrays:
        array = np.atleast_2d(np.asarray(array, float))
        if array.ndim != 2 or array.shape[1] != len(arm):
            raise InputError("samples", f"have shape {array.shape}; expected (N, {len(arm)}) for this arm")
        found.append(array)
    return found


def in_blocks(compute: Callable[..., Array], *arrays: Array) -> Array:
    """``compute``, which treats each row alike, of arrays (N, ...) or (1, ...), BLOCK rows at a time.

    Its hundreds of intermediate results then stay in the cache, where those of all rows would take a hundred times the
    memory of the result.
    """
    rows = max(map(len, arrays))
    if rows <= BLOCK:
        return compute(*arrays)
    blocks = (slice(first, first + BLOCK) for first in range(0, rows, BLOCK))
    return np.concatenate([compute(*(one if len(one) == 1 else one[block] for one in arrays)) for block in blocks])


def turns(chain: newton_euler.Chain, q: Array) -> list[tuple[Any, Any]]:
    """(cos q, sin q) of every joint, (N,) each, for q (N, n)."""
    return newton_euler.turns(chain, list(q.T), np.cos, np.sin)


def stacked(columns: list[Any], shape: tuple[int, ...]) -> Array:
    """(*shape, columns) from numbers and arrays."""
    return np.stack([np.broadcast_to(np.asarray(column, float), shape) for column in columns], axis=-1)


def rigid_torque(arm: Arm, q: Array, qd: Array, qdd: Array, *, gravity: bool = True) -> Array:
    """(N, n) torque of the rigid links, the water round them and their own friction: no drives, no effects."""
    return in_blocks(partial(_rigid_torque, arm, gravity), *samples(arm, q, qd, qdd))


def _rigid_torque(arm: Arm, gravity: bool, q: Array, qd: Array, qdd: Array) -> Array:
    chain = newton_euler.chain_of(arm)
    state = turns(chain, q), list(q.T), list(qd.T), list(qdd.T), arm.gravity if gravity else (0.0, 0.0, 0.0)
    tau = newton_euler.inverse_dynamics(chain, _bodies(arm.base, arm.joints), *state)
    total = stacked(tau, q.shape[:1])
    if wet := hydrodynamics.bodies_of(arm):
        total = total + stacked(hydrodynamics.torques(chain, wet, *state), q.shape[:1])
    if any(joint.drag for joint in arm.joints):
        total = total + np.array([joint.drag or 0.0 for joint in arm.joints]) * np.abs(qd) * qd
    return total + link_friction(arm, qd)


def mass_matrix(arm: Arm, q: Array, *, rotors: bool = True) -> Array:
    """(N, n, n) mass matrix, with the water's added mass.

    The reflected rotor inertias are on the diagonal unless ``rotors`` is False.
    """
    return in_blocks(partial(_mass_matrix, arm, rotors), *samples(arm, q))


def _mass_matrix(arm: Arm, rotors: bool, q: Array) -> Array:
    chain = newton_euler.chain_of(arm)
    state = turns(chain, q), list(q.T)
    rigid = newton_euler.mass_matrix(chain, _bodies(arm.base, arm.joints), *state)
    added = hydrodynamics.mass_matrix(chain, hydrodynamics.bodies_of(arm), *state)
    matrix = np.stack([stacked([*map(sum, zip(*rows))], q.shape[:1]) for rows in zip(rigid, added)], axis=-2)
    if rotors:
        matrix = matrix + np.diag(arm.joint_array("ratio") ** 2 * arm.joint_array("rotor_inertia"))
    return matrix


def drive_rigid_torque(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """(N, n) torque of the rigid links at the drives, over angles that the controller reports, q, qd, qdd (N, n).

    C^T tau(C q, C q', C q''), C the arm's coupling matrix; without couplings this is ``rigid_torque``.
    """
    torque = rigid_torque(arm, *(arm.link_angles(one) for one in samples(arm, q, qd, qdd)))
    return torque @ arm.coupling_matrix if arm.coupling else torque


def drive_mass_matrix(arm: Arm, q: Array, *, rotors: bool = True) -> Array:
    """(N, n, n) mass matrix over the angles that the controller reports, q (N, n): C^T M C, and rotors if asked for.

    C is the arm's coupling matrix; without couplings this is ``mass_matrix``.
    """
    if not arm.coupling:
        return mass_matrix(arm, q, rotors=rotors)
    matrix = arm.coupling_matrix
    (q,) = samples(arm, q)
    found = np.asarray(matrix.T @ mass_matrix(arm, arm.link_angles(q), rotors=False) @ matrix, float)
    return found + np.diag(arm.joint_array("ratio") ** 2 * arm.joint_array("rotor_inertia")) if rotors else found
