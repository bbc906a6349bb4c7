"""Lagrange's and Kane's equations by sympy.physics.mechanics: an oracle that shares only the model file with ours.

The arm is given to sympy as the file has it: masses, centres of mass and inertias about them, in the frames of the
links. sympy's expressions are trees; beyond three joints or so they take minutes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import described
from arm_model.rigid_body.kinematics import placement


@dataclass(frozen=True)
class SympyEquations:
    """mass_matrix q'' = forcing + tau, in the symbols q and qd; sympy matrices."""

    q: list[Any]
    qd: list[Any]
    mass_matrix: Any
    forcing: Any

    def operations(self) -> int:
        """Of the mass matrix and the forcing together, common parts counted once (sympy.cse)."""
        import sympy

        shared, reduced = sympy.cse([self.mass_matrix, self.forcing])
        return int(sum(sympy.count_ops(part) for _, part in shared) + sum(sympy.count_ops(part) for part in reduced))

    def torque(self) -> Callable[[Array, Array, Array], Array]:
        """(q, qd, qdd), (N, n) each -> (N, n) joint torques."""
        import sympy

        evaluate = sympy.lambdify([self.q, self.qd], [self.mass_matrix, self.forcing], cse=True)

        def torque(q: Array, qd: Array, qdd: Array) -> Array:
            rows = []
            for sample, speed, acceleration in zip(q, qd, qdd):
                matrix, forcing = evaluate(sample, speed)
                rows.append(np.asarray(matrix, float) @ acceleration - np.asarray(forcing, float).ravel())
            return np.array(rows)

        return torque


def kane(arm: Arm) -> SympyEquations:
    """sympy's KanesMethod on the rigid links of an arm."""
    from sympy.physics.mechanics import KanesMethod, dynamicsymbols

    n = len(arm)
    u = list(dynamicsymbols(f"u1:{n + 1}"))
    q = list(dynamicsymbols(f"q1:{n + 1}"))
    world, bodies, loads, _ = _multibody(arm, q, u)
    method = KanesMethod(world, q_ind=q, u_ind=u, kd_eqs=[b - a.diff() for a, b in zip(q, u)])
    method.kanes_equations(bodies, loads)
    return _plain(q, u, method.mass_matrix, method.forcing)


def lagrange(arm: Arm) -> SympyEquations:
    """sympy's LagrangesMethod on the rigid links of an arm."""
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    q = list(dynamicsymbols(f"q1:{len(arm) + 1}"))
    qd = [one.diff() for one in q]
    world, bodies, _, potential = _multibody(arm, q, qd)
    kinetic = sum(body.kinetic_energy(world) for body in bodies)
    method = LagrangesMethod(kinetic - potential, q)
    method.form_lagranges_equations()
    return _plain(q, qd, method.mass_matrix, method.forcing)


def _multibody(arm: Arm, q: list[Any], u: list[Any]) -> tuple[Any, list[Any], list[Any], Any]:
    """World frame, bodies, weights (point, force) and the potential energy; the joints move at u."""
    from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, inertia

    arm = described(arm)
    world, origin = ReferenceFrame("N"), Point("O")
    origin.set_vel(world, 0)
    weight = _vector(world, arm.gravity)
    frame, place = _fixed("base", world, origin, np.array(arm.base), world)
    bodies, loads, potential = [], [], 0
    for number, (joint, angle, speed) in enumerate(zip(arm.joints, q, u), 1):
        before, after = placement(joint)
        frame, place = _fixed(f"before{number}", frame, place, before, world)
        moved = ReferenceFrame(f"joint{number}")
        if joint.revolute:
            moved.orient_axis(frame, frame.z, angle)
            moved.set_ang_vel(frame, speed * frame.z)
        else:
            moved.orient_axis(frame, frame.z, 0)
            slid = place.locatenew(f"slid{number}", angle * frame.z)
            slid.set_vel(world, place.vel(world) + (frame.ang_vel_in(world) ^ (angle * frame.z)) + speed * frame.z)
            place = slid
        frame, place = _fixed(f"link{number}", moved, place, after, world)
        centre = place.locatenew(f"centre{number}", _vector(frame, joint.com))
        centre.v2pt_theory(place, world, frame)
        xx, yy, zz, xy, yz, xz = (_exact(value) for value in joint.inertia)
        about = inertia(frame, xx, yy, zz, xy, yz, xz)
        mass = _exact(joint.mass)
        bodies.append(RigidBody(f"body{number}", centre, frame, mass, (about, centre)))
        loads.append((centre, mass * weight))
        potential = potential - mass * (weight & centre.pos_from(origin))
    return world, bodies, loads, potential


def _fixed(name: str, frame: Any, place: Any, pose: Array, world: Any) -> tuple[Any, Any]:
    """A frame and its origin, at the pose (4, 4) in ``frame`` at ``place``, fixed to it."""
    import sympy
    from sympy.physics.mechanics import ReferenceFrame

    turned = ReferenceFrame(name)
    turned.orient_explicit(frame, sympy.Matrix(3, 3, [_exact(value) for value in pose[:3, :3].ravel()]))
    turned.set_ang_vel(frame, 0 * frame.x)
    point = place.locatenew(name, _vector(frame, pose[:3, 3]))
    point.v2pt_theory(place, world, frame)
    return turned, point


def _vector(frame: Any, values: Any) -> Any:
    x, y, z = (_exact(value) for value in values)
    return x * frame.x + y * frame.y + z * frame.z


def _exact(value: float) -> Any:
    """Whole numbers as such, so that products by 0 and 1 vanish."""
    import sympy

    return sympy.Integer(int(value)) if value == int(value) else sympy.Float(float(value))


def _plain(q: list[Any], u: list[Any], matrix: Any, forcing: Any) -> SympyEquations:
    """Functions of time replaced by symbols, which differentiate and print no more."""
    import sympy

    names = [*sympy.symbols(f"q1:{len(q) + 1}")], [*sympy.symbols(f"qd1:{len(q) + 1}")]
    # Speeds first: where they are derivatives of q, q must still be there.
    for old, new in ((u, names[1]), (q, names[0])):
        swap = dict(zip(old, new))
        matrix, forcing = matrix.xreplace(swap), forcing.xreplace(swap)
    return SympyEquations(names[0], names[1], matrix, forcing)
