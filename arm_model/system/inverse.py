"""Inverse dynamics of an arm with effects.

The tape of ``arm_model.system.closed_loop_system`` the other way round. Of many rows the rigid links, which are most of
it, are evaluated by compiled code, and the rest too once an arm of its kind has been asked for often enough.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, check_terms
from arm_model.geometry import relinked
from arm_model.rigid_body.numeric import in_blocks, stacked
from arm_model.symbolic.rows import Rows, rows_of
from arm_model.symbolic.tape import Expr, Tape, evaluate, needed
from arm_model.system.along_motion import FEW, links_torque, wet
from arm_model.system.kernel_inputs import numbers
from arm_model.system.links import Symbols, on_links, rigid_links
from arm_model.system.mechanics import Joints, Mechanics
from arm_model.system.warmth import warmth_knots

MOVING = ("theta", "speed", "rate", "links")
"""What a motion has per joint: angles, speeds and accelerations of the motors, torques of the rigid links."""
WORTH_COMPILING = 1e8
"""Rows times nodes that numpy evaluates in 0.1 s (1.1 ns each), in which 1400 nodes are compiled."""


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
    algebraic_arm = replace(arm, effects=algebraic)
    places = [number for number, term in enumerate(arm.effects) if term in algebraic]
    for new, old in enumerate(places):
        prefix = f"effect{old}."
        moved = {f"effect{new}.{name.removeprefix(prefix)}": v for name, v in inputs.items() if name.startswith(prefix)}
        inputs |= moved
    zeros = frozenset(name for name, value in inputs.items() if not value.any())
    compiled = len(theta) >= FEW and not wet(arm)
    equations = _equations(_Structure(algebraic_arm, compiled), zeros)
    n, moving = len(arm), [time, theta, speed, acceleration]
    of_links = np.zeros((len(theta), 0))
    if equations.links_given:
        zero, bodies, gravity = (
            np.array([[inputs[name][0] for name in row] for row in rows])
            for rows in (
                [[f"zero{j}" for j in range(n)]],
                [[f"body{j}.{k}" for k in range(10)] for j in range(n)],
                [[f"gravity{k}" for k in range(3)]],
            )
        )
        motion = (theta, speed, acceleration)
        if equations.links.asked:
            q, qd, qdd = np.split(equations.links.along(inputs, *moving), 3, axis=1)
            motion = (q, qd, qdd)
        of_links = links_torque(arm, bodies, gravity[0], (motion[0] + zero, *motion[1:]))
    return equations.torque.along(inputs, *moving, of_links)


class _Structure:
    """An arm as its equations see it.

    Equal to any other with the same joints, base and kinds of effects, whatever the effects' parameters. ``compiled``:
    torques of the rigid links are given, so that their geometry and their bodies do not matter.
    """

    def __init__(self, arm: Arm, compiled: bool) -> None:
        self.arm, self.compiled = arm, compiled
        terms = tuple((term.name, term.joint) for term in arm.effects)
        warm = tuple(warmth_knots(arm, j) for j in range(len(arm)))
        drives = [(j.ratio, None if j.friction_curve is None else len(j.friction_curve.speed)) for j in arm.joints]
        rest = [getattr(arm, one.name) for one in fields(arm) if one.compare and one.name != "effects"]
        self.key = repr((drives, arm.coupling) if compiled else rest), terms, warm, compiled

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Structure) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


class _Part:
    """Expressions of a tape that are asked for along motions; ``asked`` may be none.

    By numpy, until the rows that they have been asked for would have paid for compiled code.
    """

    def __init__(self, tape: Tape, asked: list[Expr]) -> None:
        self.asked = asked
        self._tape, self._order = tape, needed(tape, asked)
        self._rows = 0
        self._compiled: tuple[Rows, list[str]] | None = None

    def along(self, inputs: Mapping[str, Array], time: Array, *motion: Array) -> Array:
        """(N, asked) at ``time`` (N,) s of a motion of the motors, and of torques of the links after it, (N, n) each.

        inputs: the arm's numbers.
        """
        columns = [f"{name}{j}" for name, values in zip(MOVING, motion) for j in range(values.shape[1])]
        self._rows += len(time)
        if self._compiled is None and self._rows * len(self._order) >= WORTH_COMPILING:
            inside = {self._tape.nodes[index].name for index in self._order}
            names = [name for name in inputs if name in inside]
            self._compiled = rows_of(self._tape, self.asked, ["time", *columns], names), names
        if self._compiled is not None:
            program, names = self._compiled
            given = np.array([inputs[name][0] for name in names])
            return in_blocks(partial(program, given), time[:, None], *motion)

        def by_numpy(time: Array, *motion: Array) -> Array:
            moving = dict(zip(columns, np.concatenate([values.T for values in motion])))
            values = evaluate(self._tape, self.asked, {**inputs, **moving, "time": time}, self._order)
            return stacked(values, time.shape)

        return in_blocks(by_numpy, time, *motion)


@dataclass(frozen=True)
class _Equations:
    """Torques of the motors on a tape.

    links: angles, speeds and accelerations (3 n) of the links; nothing where they move as the motors do. links_given:
    torques of the rigid links, at the links, are the inputs ``links{j}``.
    """

    torque: _Part
    links: _Part
    links_given: bool


@lru_cache(maxsize=32)
def _equations(structure: _Structure, zeros: frozenset[str]) -> _Equations:
    """Torques of the motors as functions of ``theta{j}``, ``speed{j}``, ``rate{j}``, ``time`` and the arm's numbers.

    zeros: those of the arm's numbers that are 0, and left out of the equations.
    """
    arm, compiled = structure.arm, structure.compiled
    tape, n = Tape(), len(arm)
    symbol = Symbols(tape, zeros)
    mechanics = Mechanics(arm, symbol)
    angles = [tape.input(f"theta{j}") for j in range(n)]
    speeds = [tape.input(f"speed{j}") for j in range(n)]
    rates = [tape.input(f"rate{j}") for j in range(n)]
    zero, shape = [tape.constant(0.0)] * n, mechanics.shape(angles, speeds)
    joints = Joints(angles, speeds, shape, zero, tape.input("time"))
    if compiled:
        acting = on_links(symbol, mechanics, joints)
        load = shape.pulled([tape.input(f"links{j}") + own for j, own in enumerate(acting)])
    else:
        links = rigid_links(arm, symbol, mechanics, joints)
        load = [sum((links.matrix[j][k] * rates[k] for k in range(n)), links.carried[j]) for j in range(n)]
    motion: list[Expr] = []
    if shape.slope is not None:
        pushed = [sum((row[k] * rates[k] for k in range(n)), shape.bias[j]) for j, row in enumerate(shape.slope)]
        motion = [*shape.q, *shape.qd, *pushed]
    drag = mechanics.drag(replace(joints, load=load))
    torque = [load[j] + symbol(f"rotor{j}") * rates[j] + drag.torque[j] for j in range(n)]
    return _Equations(_Part(tape, torque), _Part(tape, motion), compiled)
