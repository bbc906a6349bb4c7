"""An arm on a floating base, vectorised over N samples with plain numpy: wrench, torques, mass matrix.

Shapes: attitude (N, 4) unit quaternions w, x, y, z, body to world; velocity (N, 6) of the base and its rate, body
frame (``arm_model.tables.floating_base``); q, qd, qdd (N, n). Generalised forces are (N, 6 + n): wrench on the base in
the body frame, then joint torques; N, N m. Drives and effects are not in them, rotors where it is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.moving_base import recursion
from arm_model.moving_base.recursion import DOF, BaseMotion
from arm_model.rigid_body import hydrodynamics, newton_euler, numeric
from arm_model.rigid_body.inertia import barycentric
from arm_model.rigid_body.link_friction import link_friction
from arm_model.tables.floating_base import FloatingBase


def floating(arm: Arm) -> FloatingBase:
    """The floating base of an arm; InputError where it is fixed."""
    if arm.floating is None:
        raise InputError(arm.name, 'has a fixed base; a floating one is a table [base] with kind = "floating"')
    return arm.floating


@dataclass(frozen=True)
class BaseRows:
    """N samples of a base: attitude (N, 4), velocity (N, 6) and, where it matters, the rate of the velocity (N, 6)."""

    attitude: Array
    velocity: Array
    rate: Array | None = None

    def motion(self, gravity: Sequence[float]) -> BaseMotion:
        """The same in the body frame; ``gravity`` (3,) m/s2 in the world."""
        rows = recursion.rotation(list(np.asarray(self.attitude, float).T))
        rate = np.zeros_like(self.velocity) if self.rate is None else np.asarray(self.rate, float)
        return BaseMotion(list(np.asarray(self.velocity, float).T), list(rate.T), recursion.into_body(rows, gravity))


def _at(arm: Arm, q: Array) -> recursion.Configuration:
    turn = numeric.turns(newton_euler.chain_of(arm), q)
    return recursion.configuration(arm, turn, list(q.T))


def _base_body(arm: Arm) -> tuple[float, ...]:
    base = floating(arm)
    return tuple(map(float, barycentric(base.mass, base.com, base.inertia)))


def forces_with_base(arm: Arm, base: BaseRows, q: Array, qd: Array, qdd: Array, *, base_water: bool = True) -> Array:
    """(N, 6 + n) wrench of the thrusters and torque of the rigid links for a motion, with the water and link friction.

    base_water False leaves out what the water does to the base itself (not to the links).
    """
    q, qd, qdd = numeric.samples(arm, q, qd, qdd)
    motion = base.motion(arm.gravity)
    bodies, wet = [tuple(body) for body in numeric.bodies(arm)], hydrodynamics.bodies_of(arm)
    forces = recursion.forces(_at(arm, q), _base_body(arm), bodies, wet, motion, list(qd.T), list(qdd.T))
    total = numeric.stacked(forces, q.shape[:1])
    if base_water:
        water = recursion.water_wrench(recursion.water_of_base(arm), motion)
        total[:, :DOF] += numeric.stacked(water, q.shape[:1])
    total[:, DOF:] += np.array([joint.drag or 0.0 for joint in arm.joints]) * np.abs(qd) * qd
    total[:, DOF:] += link_friction(arm, qd)
    return total


def mass_matrix_with_base(arm: Arm, q: Array) -> Array:
    """(N, 6 + n, 6 + n) mass matrix of base and links with their added mass, without rotors."""
    (q,) = numeric.samples(arm, q)
    bodies, wet = [tuple(body) for body in numeric.bodies(arm)], hydrodynamics.bodies_of(arm)
    rows = recursion.mass_matrix(_at(arm, q), _base_body(arm), bodies, wet)
    matrix = np.stack([numeric.stacked(row, q.shape[:1]) for row in rows], axis=-2)
    matrix[:, :DOF, :DOF] += floating(arm).added
    return matrix


def rotations(attitude: Array) -> Array:
    """(..., 3, 3) rotation matrices, body to world, of quaternions (..., 4) w, x, y, z."""
    attitude = np.asarray(attitude, float)
    rows = recursion.rotation([attitude[..., k] for k in range(4)])
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
