"""What may have changed in an arm, each as a direction in the space of the compared values.

Level, slope, asymmetry and hump of a joint's friction, friction by load, a rotor, a parameter of an effect, the body of
a link (ten parameters, of which some combinations show), the scale of a joint's currents; and effects beyond the model
(``effects``), whose columns come after those of the compared values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from comparison.change import Quantity
from comparison.friction_drift import friction_shapes
from comparison.joint_fit.effects import Added
from comparison.load_friction import loaded_joints
from comparison.quantities import values_quantities
from comparison.regression import Structure
from comparison.wording import in_words


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One possible change; equal to itself alone.

    what        friction, inertia, effect or scale: those of one kind scatter alike between recordings
    joint       from 1; None: of the whole arm
    directions  (c, k) change of the compared values per unit of each coefficient
    quantity    the compared quantity that it changes by its coefficient; "" of several
    added       the effect beyond the model that it is of
    tries       number of alternatives among which it was chosen
    """

    what: str
    joint: int | None
    directions: Array
    quantity: str = ""
    added: Added | None = None
    tries: int = 1

    @property
    def words(self) -> str:
        """'Coulomb friction of joint 3', 'base tilt', 'body of link 2'."""
        if self.quantity:
            return in_words(self.quantity)
        if self.added is not None:
            effect = self.added.effect.replace("_", " ")
            return effect if self.joint is None else f"{effect} of joint {self.joint}"
        if self.what == "scale":
            return f"scale of the currents of joint {self.joint}"
        if self.what == "friction":
            return f"friction near rest of joint {self.joint}"
        return f"body of link {self.joint}" if self.directions.shape[1] > 1 else f"rotor inertia of joint {self.joint}"


def hypotheses(structure: Structure, added: Sequence[Added]) -> list[Hypothesis]:
    """All of an arm."""
    described = [*_of_friction(structure), *_of_bodies(structure), *_single(structure)]
    candidates = [*_widened(structure, described, added), *_of_added(structure, added), *_of_scales(structure, added)]
    return [one for one in candidates if np.abs(one.directions).max(initial=0.0) > 0.0]


def chance(one: float, every: Sequence[Hypothesis]) -> float:
    """Natural logarithm of a chance, from that of a single test, with the number of alternatives that were tried."""
    return one + float(np.log(sum(each.tries for each in every)))


def size_with(structure: Structure, added: Sequence[Added]) -> int:
    """Number of the values of a joint fit: those compared, of effects beyond the model, and scales of the joints."""
    return structure.size + sum(len(one.units) for one in added) + len(structure.arm)


def _widened(structure: Structure, every: Sequence[Hypothesis], added: Sequence[Added]) -> list[Hypothesis]:
    more = size_with(structure, added) - structure.size
    return [replace(one, directions=np.pad(one.directions, ((0, more), (0, 0)))) for one in every]


def _of_added(structure: Structure, added: Sequence[Added]) -> Iterator[Hypothesis]:
    size, first = size_with(structure, added), structure.size
    for one in added:
        directions = np.eye(size)[:, first : (first := first + len(one.units))]
        if one.effect == "gravity_spring" and one.joint is not None:
            constant = friction_shapes(structure, one.joint - 1)[2]
            directions = np.column_stack([directions, np.pad(constant, (0, size - structure.size))])
        yield Hypothesis("effect beyond the model", one.joint, directions, added=one, tries=one.tries)


def single_values(structure: Structure, added: Sequence[Added]) -> list[Hypothesis]:
    """Each compared value alone, in their order."""
    single = [_unit(structure, k, quantity) for k, quantity in enumerate(values_quantities(structure))]
    return _widened(structure, single, added)


def _unit(structure: Structure, k: int, quantity: Quantity) -> Hypothesis:
    kind = "friction" if quantity.kind == "curve" else quantity.kind
    return Hypothesis(kind, quantity.joint, np.eye(structure.size)[:, k : k + 1], quantity.name)


def _of_friction(structure: Structure) -> Iterator[Hypothesis]:
    for joint in range(len(structure.arm)):
        names = [f"joint{joint + 1}.{name}" for name in ("coulomb", "viscous", "offset")]
        for shape, name in zip(friction_shapes(structure, joint), [*names, ""]):
            yield Hypothesis("friction", joint + 1, shape[:, None], name)


def _of_bodies(structure: Structure) -> Iterator[Hypothesis]:
    for link in range(1, len(structure.arm) + 1):
        yield Hypothesis("inertia", link, structure.by_body(link))


def point_masses(structure: Structure, added: Sequence[Added]) -> list[Hypothesis]:
    """A mass at a point of each link: less than a body, and with four coefficients surer where recordings are few."""
    links = range(1, len(structure.arm) + 1)
    return _widened(structure, [Hypothesis("inertia", link, structure.by_body(link)[:, :4]) for link in links], added)


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


def _of_scales(structure: Structure, added: Sequence[Added]) -> Iterator[Hypothesis]:
    size, joints = size_with(structure, added), len(structure.arm)
    for joint, direction in enumerate(np.eye(size)[size - joints :]):
        yield Hypothesis("scale", joint + 1, direction[:, None])
