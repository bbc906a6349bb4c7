"""What may have changed in an arm, each as a direction in the space of the compared values.

Level, slope, asymmetry and hump of a joint's friction, friction by load, a rotor, a parameter of an effect, the body of
a link (ten parameters, of which some combinations show), the scale of a joint's currents.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from comparison.change import Quantity
from comparison.load_friction import loaded_joints
from comparison.quantities import values_quantities
from comparison.regression import Fitted, Structure

BODY = ("mass", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True)
class Hypothesis:
    """One possible change.

    what        friction, inertia, effect or scale: those of one kind scatter alike between recordings
    joint       from 1; None: of the whole arm
    directions  (c, k) change of the compared values per unit of each coefficient
    quantity    the compared quantity that it changes by its coefficient; "" of several
    """

    what: str
    joint: int | None
    directions: Array
    quantity: str = ""


def hypotheses(structure: Structure, fits: Sequence[Fitted]) -> list[Hypothesis]:
    """All of an arm; ``fits`` of the recordings after, whose currents may have another scale."""
    every = [
        *_of_friction(structure),
        *_of_bodies(structure),
        *_single(structure),
        *_of_scales(structure, fits),
    ]
    return [one for one in every if np.abs(one.directions).max(initial=0.0) > 0.0]


def single_values(structure: Structure) -> list[Hypothesis]:
    """Each compared value alone, in their order."""
    return [_unit(structure, k, quantity) for k, quantity in enumerate(values_quantities(structure))]


def _unit(structure: Structure, k: int, quantity: Quantity) -> Hypothesis:
    what = "friction" if quantity.kind == "curve" else quantity.kind
    return Hypothesis(what, quantity.joint, np.eye(structure.size)[:, k : k + 1], quantity.name)


def _of_friction(structure: Structure) -> Iterator[Hypothesis]:
    start = len(structure.rows)
    for joint in range(len(structure.arm)):
        places = [(start + k, *point) for k, point in enumerate(structure.points) if point[0].joint == joint]
        shapes = np.zeros((4, structure.size))
        for row, curve, k in places:
            shapes[:, row] = 1.0, curve.speeds[k], curve.direction, float(k == 0)
        names = [f"joint{joint + 1}.{name}" for name in ("coulomb", "viscous", "offset")]
        for shape, name in zip(shapes, [*names, ""]):
            yield Hypothesis("friction", joint + 1, shape[:, None], name)


def _of_bodies(structure: Structure) -> Iterator[Hypothesis]:
    base, count = structure.base, len(structure.rows)
    for link in range(1, len(structure.arm) + 1):
        columns = [base.names.index(f"link{link}.{name}") for name in BODY]
        directions = np.zeros((structure.size, len(columns)))
        directions[:count] = base.grouping[structure.rows][:, columns]
        yield Hypothesis("inertia", link, directions)


def _single(structure: Structure) -> Iterator[Hypothesis]:
    """Rotors, parameters of effects, and friction by load."""
    base, first = structure.base, structure.size - len(loaded_joints(structure.loads))
    for k, quantity in enumerate(values_quantities(structure)):
        if quantity.kind == "effect" or k >= first:
            yield _unit(structure, k, quantity)
    for column, name in enumerate(base.names):
        if name.endswith(".rotor_inertia"):
            direction = np.zeros((structure.size, 1))
            direction[: len(structure.rows), 0] = base.grouping[structure.rows][:, column]
            yield Hypothesis("inertia", int(name.removeprefix("joint").partition(".")[0]), direction)


def _of_scales(structure: Structure, fits: Sequence[Fitted]) -> Iterator[Hypothesis]:
    scale = np.mean([one.by_scale for one in fits], axis=0)
    for joint in range(len(structure.arm)):
        yield Hypothesis("scale", joint + 1, scale[:, joint : joint + 1])
