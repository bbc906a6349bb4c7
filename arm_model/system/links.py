"""The rigid links of an arm as expressions, in the coordinates of its transmissions; on a floating base or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm_model.description import Arm
from arm_model.moving_base.recursion import DOF
from arm_model.rigid_body import hydrodynamics, newton_euler, scalar
from arm_model.symbolic.tape import Expr, Tape
from arm_model.system import floating_base
from arm_model.system.mechanics import Joints, Matrix, Mechanics, Shape


@dataclass(frozen=True)
class Symbols:
    """Inputs of the tape; those whose value is zero in every lane are the constant zero, and cost nothing."""

    tape: Tape
    zero: frozenset[str]

    def __call__(self, name: str) -> Expr:
        return self.tape.constant(0.0) if name in self.zero else self.tape.input(name)


@dataclass(frozen=True)
class Links:
    """The rigid links in transmission coordinates: torque without acceleration, and the mass matrix.

    On a floating base both begin with the six rows of the base.
    """

    carried: list[Expr]
    matrix: Matrix


def rigid_links(
    arm: Arm, symbol: Symbols, mechanics: Mechanics, joints: Joints, base: floating_base.Base | None = None
) -> Links:
    """Links of the arm at ``joints``, with the water round them and their effects, without a load.

    ``base``: where the base floats and moves; absent, it stands.
    """
    n, tape, shape = len(arm), symbol.tape, joints.shape
    if base is not None:
        return _links_on_base(arm, symbol, mechanics, joints, base)
    chain = newton_euler.chain_of(arm)
    q = [shape.q[j] + symbol(f"zero{j}") for j in range(n)]
    turn = newton_euler.turns(chain, q, scalar.cos, scalar.sin)
    bodies = _bodies(symbol, n)
    gravity = [symbol(f"gravity{k}") for k in range(3)]
    wet = _cylinders(arm, symbol, chain)
    bias = newton_euler.inverse_dynamics(chain, bodies, turn, q, shape.qd, shape.bias, gravity)
    water = hydrodynamics.torques(chain, wet, turn, q, shape.qd, shape.bias, gravity)
    rigid, added = newton_euler.mass_matrix(chain, bodies, turn, q), hydrodynamics.mass_matrix(chain, wet, turn, q)
    matrix = [[tape.expr(a) + b for a, b in zip(*rows)] for rows in zip(rigid, added)]
    acting = on_links(symbol, mechanics, joints)
    torque = [tape.expr(bias[j]) + water[j] + acting[j] for j in range(n)]
    return Links(shape.pulled(torque), shape.congruent(matrix))


def on_links(symbol: Symbols, mechanics: Mechanics, joints: Joints) -> list[Expr]:
    """(n,) torques that the joints overcome besides those of rigid links: drag, the links' own friction, effects."""
    shape = joints.shape
    return [
        symbol(f"drag{j}") * abs(shape.qd[j]) * shape.qd[j] + _own_friction(symbol, shape, j) + acting
        for j, acting in enumerate(mechanics.link_torques(joints))
    ]


def _bodies(symbol: Symbols, n: int) -> list[tuple[Expr, ...]]:
    return [tuple(symbol(f"body{j}.{k}") for k in range(10)) for j in range(n)]


def on_base(arm: Arm, symbol: Symbols, q: Sequence[Expr]) -> floating_base.Links:
    """The rigid links with their motors at q, on the arm's floating base."""
    at = floating_base.turned(arm, [q[j] + symbol(f"zero{j}") for j in range(len(arm))])
    return floating_base.Links(at, _bodies(symbol, len(arm)), _cylinders(arm, symbol, at.links))


def _links_on_base(arm: Arm, symbol: Symbols, mechanics: Mechanics, joints: Joints, base: floating_base.Base) -> Links:
    n, shape = len(arm), joints.shape
    links = on_base(arm, symbol, shape.q)
    wrench = floating_base.carried(base, links, symbol, shape.qd, shape.bias)
    matrix = floating_base.matrix(base, links, symbol)
    acting = on_links(symbol, mechanics, joints)
    torque = [wrench[DOF + j] + acting[j] for j in range(n)]
    shared = [shape.pulled(row[DOF:]) for row in matrix[:DOF]]  # base and joints, (6, n)
    inner = shape.congruent([row[DOF:] for row in matrix[DOF:]])
    upper = [[*matrix[i][:DOF], *shared[i]] for i in range(DOF)]
    lower = [[*(shared[i][j] for i in range(DOF)), *inner[j]] for j in range(n)]
    return Links([*wrench[:DOF], *shape.pulled(torque)], [*upper, *lower])


def _own_friction(symbol: Symbols, shape: Shape, j: int) -> Expr:
    """Friction of the axis of joint j itself (``arm_model.rigid_body.link_friction``)."""
    coulomb, speed = symbol(f"link_coulomb{j}"), shape.qd[j]
    viscous = symbol(f"link_viscous{j}") * speed
    if coulomb.value == 0.0:
        return viscous
    return viscous + coulomb * scalar.smooth_sign(speed, symbol(f"sign_velocity{j}"))


def _cylinders(arm: Arm, symbol: Symbols, chain: newton_euler.Chain) -> hydrodynamics.Bodies:
    """The cylinders of the arm that any lane has water round."""
    found = {}
    for j, joint in enumerate(arm.joints):
        if joint.cylinder is not None:
            water = [symbol(f"{name}{j}") for name in ("resistance", "added", "displaced")]
            if any(coefficient.value != 0.0 for coefficient in water):
                found[j] = hydrodynamics.shape_of(chain, j, joint.cylinder), hydrodynamics.Water(*water)
    return found
