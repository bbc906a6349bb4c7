"""What Lagrange's and Kane's equations start from: velocities of the links and gravity, on a tape, in the joint frames.

Inputs of the tape: q{j}, qd{j}, qdd{j} (from 0; rad, rad/s, rad/s2, or m) and the arm's numbers, body{j}.{k} and
gravity{k}, as ``arm_model.system.kernel_inputs`` names them. What is zero in the arm is the constant zero, as in the
equations that are compiled. Vectors are (3,) numpy arrays of expressions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import described
from arm_model.rigid_body import newton_euler
from arm_model.symbolic.tape import Expr, Tape
from arm_model.system.kernel_inputs import numbers

Vector = NDArray[Any]


@dataclass(frozen=True)
class Symbols:
    """The variables of an arm on a tape, and the values that its numbers have."""

    tape: Tape
    chain: newton_euler.Chain
    bodies: list[tuple[Expr, ...]]
    gravity: list[Expr]
    q: list[Expr]
    qd: list[Expr]
    qdd: list[Expr]
    values: dict[str, Array]

    def at_rest(self) -> Symbols:
        """The same without accelerations."""
        return replace(self, qdd=[self.tape.constant(0.0)] * len(self.q))


def symbols_of(arm: Arm) -> Symbols:
    """The rigid links of an arm, its effects on the description (a payload, say) carried out, the others left out."""
    rigid = replace(described(arm), effects=())
    values, tape, n = numbers(rigid), Tape(), len(rigid)

    def symbol(name: str) -> Expr:
        return tape.input(name) if values[name].any() else tape.constant(0.0)

    return Symbols(
        tape=tape,
        chain=newton_euler.chain_of(rigid),
        bodies=[tuple(symbol(f"body{j}.{k}") for k in range(10)) for j in range(n)],
        gravity=[symbol(f"gravity{k}") for k in range(3)],
        q=[tape.input(f"q{j}") for j in range(n)],
        qd=[tape.input(f"qd{j}") for j in range(n)],
        qdd=[tape.input(f"qdd{j}") for j in range(n)],
        values=values,
    )


@dataclass(frozen=True)
class Link:
    """One link in its joint frame: angular velocity, velocity of the frame's origin, gravity, g.p of the origin p."""

    spin: Vector
    speed: Vector
    gravity: Vector
    drop: Expr


def links(symbols: Symbols) -> list[Link]:
    """Velocities from the base outwards.

    w_j = A^T w + q' z, v_j = A^T (v + w x r), A and r the joint's rotation and shift.
    """
    tape, chain = symbols.tape, symbols.chain
    still = np.array([tape.constant(0.0)] * 3)
    last, found = Link(still, still, np.array(symbols.gravity), tape.constant(0.0)), []
    for j, (q, qd) in enumerate(zip(symbols.q, symbols.qd)):
        rotation, reach = chain.rotation[j].astype(object), chain.shift[j].astype(object)
        if chain.revolute[j]:
            c, s = q.cos(), q.sin()
            rotation = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=object)
        else:
            reach = reach + rotation @ _along_z(q)
        spin, speed = rotation.T @ last.spin, rotation.T @ (last.speed + cross(last.spin, reach))
        if chain.revolute[j]:
            spin = spin + _along_z(qd)
        else:
            speed = speed + _along_z(qd)
        drop = last.drop + last.gravity @ reach
        last = Link(_on(tape, spin), _on(tape, speed), _on(tape, rotation.T @ last.gravity), tape.expr(drop))
        found.append(last)
    return found


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def tensor(body: tuple[Expr, ...]) -> Vector:
    """(3, 3) inertia about the origin of the joint frame."""
    xx, xy, xz, yy, yz, zz = body[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _along_z(value: Expr) -> Vector:
    return np.array([0.0, 0.0, value], dtype=object)


def _on(tape: Tape, vector: Vector) -> Vector:
    return np.array([tape.expr(value) for value in vector])
