"""Rigid torque and mass matrix along a recorded motion, compiled.

The same as ``drive_rigid_torque`` and ``drive_mass_matrix`` of ``arm_model.rigid_body``, to rounding: few rows, and
arms in water, are left to these. One program serves every arm with the same kinds of joints whose frames have their
zeros in the same places: all other numbers are given with the rows.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body import hydrodynamics, newton_euler, numeric, scalar
from arm_model.rigid_body.link_friction import link_friction
from arm_model.symbolic.rows import Rows, rows_of
from arm_model.symbolic.tape import Expr, Tape

FEW = 1000
"""Rows that numpy treats as quickly as the compiled code is found."""
Structure = tuple[tuple[bool, ...], tuple[float | None, ...]]
"""Kinds of the joints, and the entries of all frames (rotation, then shift); None: another number than 0, 1, -1."""


def rigid_torque_along(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """(N, n) N m: ``drive_rigid_torque`` of angles that the controller reports, q, qd, qdd (N, n)."""
    q, qd, qdd = np.broadcast_arrays(*numeric.samples(arm, q, qd, qdd))
    if len(q) < FEW or wet(arm):
        return numeric.drive_rigid_torque(arm, q, qd, qdd)
    links = arm.link_angles(q), arm.link_angles(qd), arm.link_angles(qdd)
    torque = links_torque(arm, numeric.bodies(arm), np.array(arm.gravity), links) + link_friction(arm, links[1])
    return torque @ arm.coupling_matrix if arm.coupling else torque


def links_torque(arm: Arm, bodies: Array, gravity: Array, motion: tuple[Array, Array, Array]) -> Array:
    """(N, n) N m at the joints from rigid links alone, whose angles, speeds and accelerations (N, n) are ``motion``.

    bodies (n, 10) in the joint frames of ``newton_euler``; gravity (3,) m/s2 in the base frame.
    """
    structure, frames = _structure(arm)
    numbers, program = np.concatenate([frames, bodies.ravel(), gravity]), _torque(structure)
    return numeric.in_blocks(lambda *rows: program(numbers, *rows), *motion)


def mass_matrix_along(arm: Arm, q: Array) -> Array:
    """(N, n, n) kg m2: ``drive_mass_matrix`` without rotors, over angles that the controller reports, q (N, n)."""
    (q,) = numeric.samples(arm, q)
    if len(q) < FEW or wet(arm):
        return numeric.drive_mass_matrix(arm, q, rotors=False)
    structure, frames = _structure(arm)
    numbers = np.concatenate([frames, numeric.bodies(arm).ravel()])
    program = _mass(structure)
    matrix = numeric.in_blocks(lambda rows: program(numbers, rows), arm.link_angles(q)).reshape(-1, len(arm), len(arm))
    return arm.coupling_matrix.T @ matrix @ arm.coupling_matrix if arm.coupling else matrix


def wet(arm: Arm) -> bool:
    """Whether the links move in water."""
    return bool(hydrodynamics.bodies_of(arm)) or any(joint.drag for joint in arm.joints)


def _structure(arm: Arm) -> tuple[Structure, Array]:
    """What the equations of an arm depend on, and the numbers of its frames that they leave open."""
    chain = newton_euler.chain_of(arm)
    entries = np.concatenate([np.append(r.ravel(), s) for r, s in zip(chain.rotation, chain.shift)])
    fixed = np.isin(entries, (0.0, 1.0, -1.0))
    kept = tuple(value if known else None for value, known in zip(entries.tolist(), fixed.tolist()))
    return (chain.revolute, kept), entries[~fixed]


@lru_cache(maxsize=32)
def _torque(structure: Structure) -> Rows:
    tape = Tape()
    chain, names, bodies = _symbols(tape, structure)
    n = len(chain)
    columns = [f"{name}{j}" for name in ("q", "qd", "qdd") for j in range(n)]
    q, qd, qdd = ([tape.input(name) for name in columns[k * n : (k + 1) * n]] for k in range(3))
    gravity = [f"gravity{k}" for k in range(3)]
    turn = newton_euler.turns(chain, q, scalar.cos, scalar.sin)
    tau = newton_euler.inverse_dynamics(chain, bodies, turn, q, qd, qdd, [tape.input(name) for name in gravity])
    return rows_of(tape, [tape.expr(one) for one in tau], columns, [*names, *gravity])


@lru_cache(maxsize=32)
def _mass(structure: Structure) -> Rows:
    tape = Tape()
    chain, names, bodies = _symbols(tape, structure)
    n = len(chain)
    columns = [f"q{j}" for j in range(n)]
    q = [tape.input(name) for name in columns]
    matrix = newton_euler.mass_matrix(chain, bodies, newton_euler.turns(chain, q, scalar.cos, scalar.sin), q)
    return rows_of(tape, [tape.expr(matrix[i][j]) for i in range(n) for j in range(n)], columns, names)


def _symbols(tape: Tape, structure: Structure) -> tuple[newton_euler.Chain, list[str], list[newton_euler.Body]]:
    """A chain with symbols for the numbers that the structure leaves open, names of all numbers, and the bodies."""
    revolute, entries = structure
    frames = [f"frame{k}" for k, value in enumerate(entries) if value is None]
    symbols = [tape.input(f"frame{k}") if value is None else value for k, value in enumerate(entries)]
    each = np.array(symbols, dtype=object).reshape(len(revolute), 12)
    chain = newton_euler.Chain(
        revolute, tuple(one[:9].reshape(3, 3) for one in each), tuple(one[9:] for one in each), ()
    )
    names = [[f"body{j}.{k}" for k in range(10)] for j in range(len(revolute))]
    bodies: list[tuple[Expr, ...]] = [tuple(tape.input(name) for name in of_body) for of_body in names]
    return chain, [*frames, *(name for of_body in names for name in of_body)], bodies
