"""The three formulations side by side: what they cost, how long they take to generate, and that they agree.

Each gives the torques tau(q, q', q'') and, for simulation, mass matrix and bias; operations are counted on the tape
(every common part once), for sympy after sympy.cse. Counted are + - * / and functions, of the rigid links with those of
their constants that are not zero.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import described
from arm_model.formulations import kane, lagrange
from arm_model.formulations.links import Symbols, symbols_of
from arm_model.rigid_body import newton_euler, scalar
from arm_model.rigid_body.hydrodynamics import dry
from arm_model.rigid_body.numeric import rigid_torque
from arm_model.symbolic.tape import Expr, derivative, evaluate, operations

SYMPY_JOINTS = 3
"""sympy's methods are asked for arms of up to so many joints; it takes them seconds there, and minutes beyond."""


Torques = Callable[[Symbols], list[Expr]]


@dataclass(frozen=True)
class Formulation:
    """One line of the table. torque_operations: of tau(q, q', q''), None where it is not what the method gives.

    system_operations: of mass matrix and bias together; seconds: to generate both; difference: largest |tau - tau_0|
    over the largest |tau_0| of the random states, tau_0 by the numerical Newton-Euler recursion.
    """

    name: str
    torque_operations: int | None
    system_operations: int
    seconds: float
    difference: float


def compare(arm: Arm, *, with_sympy: bool | None = None, states: int = 100, seed: int = 0) -> list[Formulation]:
    """Newton-Euler, Lagrange and Kane of an arm compared on ``states`` random states.

    with_sympy: sympy's own equations too; default: up to SYMPY_JOINTS joints.
    """
    rng = np.random.default_rng(seed)
    q, qd, qdd = (scale * rng.normal(size=(states, len(arm))) for scale in (1.5, 1.5, 5.0))
    wanted = rigid_torque(dry(described(arm)), q, qd, qdd)
    largest = max(float(np.abs(wanted).max()), 1e-300)

    def difference(found: Array) -> float:
        return float(np.abs(found - wanted).max()) / largest

    rows = []
    for name, torques, matrix in (
        ("Newton-Euler", TORQUES["newton-euler"], _composite_bodies),
        ("Lagrange", TORQUES["lagrange"], None),
        ("Kane", TORQUES["kane"], None),
    ):
        began = time.perf_counter()
        symbols = symbols_of(arm)
        tau, system = _generate(symbols, torques, matrix)
        seconds = time.perf_counter() - began
        error = difference(_evaluated(symbols, tau, q, qd, qdd))
        counts = operations(symbols.tape, tau), operations(symbols.tape, system)
        rows.append(Formulation(name, *counts, seconds, error))
    if with_sympy or (with_sympy is None and len(arm) <= SYMPY_JOINTS):
        rows += _of_sympy(arm, q, qd, qdd, difference)
    return rows


def _generate(symbols: Symbols, torques: Torques, matrix: Torques | None) -> tuple[list[Expr], list[Expr]]:
    """Torques; and the upper triangle of the mass matrix (by default d tau / d q''), and the torques at q'' = 0."""
    tau = torques(symbols)
    if matrix is not None:
        upper = matrix(symbols)
    else:
        upper = [derivative(tau[i], symbols.qdd[k]) for i in range(len(tau)) for k in range(i, len(tau))]
    return tau, [*upper, *torques(symbols.at_rest())]


def _recursion(symbols: Symbols) -> list[Expr]:
    turn = newton_euler.turns(symbols.chain, symbols.q, scalar.cos, scalar.sin)
    moving = symbols.q, symbols.qd, symbols.qdd
    tau = newton_euler.inverse_dynamics(symbols.chain, symbols.bodies, turn, *moving, symbols.gravity)
    return [symbols.tape.expr(value) for value in tau]


TORQUES: dict[str, Torques] = {"newton-euler": _recursion, "lagrange": lagrange.torques, "kane": kane.torques}
"""Joint torques tau(q, q', q'') of the rigid links, by the name of the formulation."""


def _composite_bodies(symbols: Symbols) -> list[Expr]:
    turn = newton_euler.turns(symbols.chain, symbols.q, scalar.cos, scalar.sin)
    matrix = newton_euler.mass_matrix(symbols.chain, symbols.bodies, turn, symbols.q)
    return [symbols.tape.expr(matrix[i][k]) for i in range(len(matrix)) for k in range(i, len(matrix))]


def _evaluated(symbols: Symbols, tau: list[Expr], q: Array, qd: Array, qdd: Array) -> Array:
    moving = {f"{name}{j}": x[:, j] for name, x in (("q", q), ("qd", qd), ("qdd", qdd)) for j in range(q.shape[1])}
    values = evaluate(symbols.tape, tau, {**symbols.values, **moving})
    return np.stack([np.broadcast_to(np.asarray(value, float), len(q)) for value in values], axis=-1)


def _of_sympy(arm: Arm, q: Array, qd: Array, qdd: Array, difference: Callable[[Array], float]) -> list[Formulation]:
    import sympy.physics.mechanics  # noqa: F401  (its import is not part of what is timed)

    from arm_model.formulations import oracles

    rows = []
    for name, method in (("sympy LagrangesMethod", oracles.lagrange), ("sympy KanesMethod", oracles.kane)):
        began = time.perf_counter()
        equations = method(arm)
        seconds = time.perf_counter() - began
        error = difference(equations.torque()(q, qd, qdd))
        rows.append(Formulation(name, None, equations.operations(), seconds, error))
    return rows
