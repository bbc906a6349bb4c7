"""Inverse dynamics of an arm with effects.

The tape of ``arm_model.system.closed_loop_system`` the other way round, evaluated with numpy; of many rows the rigid
links, which are most of it, by compiled code.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, check_terms
from arm_model.geometry import relinked
from arm_model.rigid_body.numeric import in_blocks, stacked
from arm_model.symbolic.tape import Expr, Tape, evaluate, needed
from arm_model.system.along_motion import FEW, links_torque, wet
from arm_model.system.closed_loop_system import Symbols, on_links, rigid_links
from arm_model.system.kernel_inputs import numbers
from arm_model.system.mechanics import Joints, Mechanics
from arm_model.system.warmth import warmth_knots


def torque_with_effects(arm: Arm, theta: Array, speed: Array, acceleration: Array, time: Array) -> Array:
    """(N, n) torque of the motors at the joint side for motors that move so, (N, n) each, at ``time`` (N,) s.

    The torque that the transmission carries, which load friction needs, is known here: rigid links with their
    accelerations.
    """
    check_terms(arm)
    arm = relinked(arm)
    inputs = numbers(arm)
    algebraic = tuple(
        term for term in arm.effects if CATALOGUE[term.name].spring is None and CATALOGUE[term.name].rate is None
    )
    # The numbers belong to the terms by their places, so that the list keeps its length.
    kept = replace(arm, effects=algebraic)
    places = [number for number, term in enumerate(arm.effects) if term in algebraic]
    for new, old in enumerate(places):
        prefix = f"effect{old}."
        moved = {f"effect{new}.{name.removeprefix(prefix)}": v for name, v in inputs.items() if name.startswith(prefix)}
        inputs |= moved
    zeros = frozenset(name for name, value in inputs.items() if not value.any())
    compiled = len(theta) >= FEW and not wet(arm)
    equations = _equations(_Structure(kept), zeros, compiled)
    n, of_links = len(arm), np.zeros((len(theta), 0))
    if equations.links_given:
        zero, bodies, gravity = (
            np.array([[inputs[name][0] for name in row] for row in rows])
            for rows in (
                [[f"zero{j}" for j in range(n)]],
                [[f"body{j}.{k}" for k in range(10)] for j in range(n)],
                [[f"gravity{k}" for k in range(3)]],
            )
        )
        of_links = links_torque(arm, bodies, gravity[0], (theta + zero, speed, acceleration))

    def block(theta: Array, speed: Array, acceleration: Array, time: Array, of_links: Array) -> Array:
        columns = {"theta": theta, "speed": speed, "rate": acceleration, "links": of_links}
        moving = {f"{name}{j}": column for name, values in columns.items() for j, column in enumerate(values.T)}
        values = evaluate(equations.tape, equations.torque, {**inputs, **moving, "time": time}, equations.order)
        return stacked(values, theta.shape[:1])

    return in_blocks(block, theta, speed, acceleration, time, of_links)


class _Structure:
    """An arm as its equations see it.

    Equal to any other with the same joints, base and kinds of effects, whatever the effects' parameters.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        terms = tuple((term.name, term.joint) for term in arm.effects)
        warm = tuple(warmth_knots(arm, j) for j in range(len(arm)))
        numbers_of_arm = [getattr(arm, one.name) for one in fields(arm) if one.compare and one.name != "effects"]
        self.key = repr(numbers_of_arm), terms, warm

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Structure) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True)
class _Equations:
    """Torques of the motors on a tape.

    order  the nodes that they need; links_given: torques of the rigid links are the inputs ``links{j}``
    """

    tape: Tape
    torque: list[Expr]
    order: list[int]
    links_given: bool


@lru_cache(maxsize=32)
def _equations(structure: _Structure, zeros: frozenset[str], compiled: bool) -> _Equations:
    """Torques of the motors over angles ``theta{j}``, ``speed{j}``, ``rate{j}``.

    They are over ``time`` and the arm's numbers too, of which ``zeros`` are 0. ``compiled``: torques of the rigid links
    may be the inputs ``links{j}``, and are where the links move as the motors do.
    """
    arm = structure.arm
    tape, n = Tape(), len(arm)
    symbol = Symbols(tape, zeros)
    mechanics = Mechanics(arm, symbol)
    angles = [tape.input(f"theta{j}") for j in range(n)]
    speeds = [tape.input(f"speed{j}") for j in range(n)]
    rates = [tape.input(f"rate{j}") for j in range(n)]
    zero = [tape.constant(0.0)] * n
    joints = Joints(angles, speeds, mechanics.shape(angles, speeds), zero, tape.input("time"))
    given = compiled and joints.shape.slope is None
    if given:
        load = [tape.input(f"links{j}") + own for j, own in enumerate(on_links(symbol, mechanics, joints))]
    else:
        links = rigid_links(arm, symbol, mechanics, joints)
        load = [sum((links.matrix[j][k] * rates[k] for k in range(n)), links.carried[j]) for j in range(n)]
    drag = mechanics.drag(replace(joints, load=load))
    torque = [load[j] + symbol(f"rotor{j}") * rates[j] + drag.torque[j] for j in range(n)]
    return _Equations(tape, torque, needed(tape, torque), given)
