"""Which combinations of an arm's parameters its torques can show at all.

Some links' parameters never act alone: only sums do (Gautier, "Numerical calculation of the base inertial parameters of
robots", J. Robotic Systems 8(4), 1991). Found here on random states of the arm, where nothing but its structure
decides: the rank by a column-pivoted QR, then, in an order that people like to read (drives first, then links from the
tip inwards), the columns that no earlier one makes up. Every other column is a combination of those.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from arm_io.types import Array
from arm_model import Arm, Joint, parameter, with_parameters
from arm_model.tables import Temperatures
from identification.regression.effect_columns import definition, effect_parameters, is_effect
from identification.regression.model_parameters import Friction, column_names, lifts, model_columns
from identification.regression.qr import pivoted_triangle, triangle_of

NEGLIGIBLE = 1e-8
"""Share of a column's size below which a remainder counts as rounding."""
GENERIC_ARMS = 2
"""Arms beside the model: a dependence between columns that holds on all of them is one of structure."""
SIZE = 0.1
"""m: of such arms, centres of mass are this far off, radii of gyration this large."""


@dataclass(frozen=True)
class BaseParameters:
    """b base parameters beta = grouping @ delta of p standard parameters delta: Y delta = Y[:, kept] beta for every Y.

    names (p,); kept (b,) indices of the columns that stand for a group; grouping (b, p) has the identity in the kept
    columns.
    """

    names: tuple[str, ...]
    kept: NDArray[np.intp]
    grouping: Array

    def __len__(self) -> int:
        return len(self.kept)

    def alone(self, row: int) -> bool:
        """Whether base parameter ``row`` is one standard parameter and nothing else."""
        return int(np.count_nonzero(self.grouping[row])) == 1

    def expression(self, row: int) -> str:
        """'link2.mx + 0.4318 link3.mass - link3.my'."""
        first = int(self.kept[row])
        terms = [self.names[first]]
        for column in np.flatnonzero(self.grouping[row]):
            if column != first:
                factor = self.grouping[row, column]
                size = "" if abs(abs(factor) - 1) < 1e-9 else f"{abs(factor):.6g} "
                terms.append(f"{'-' if factor < 0 else '+'} {size}{self.names[column]}")
        return " ".join(terms)


def base_parameters(
    columns: Array, names: Sequence[str], *, order: Sequence[int] | None = None, negligible: float = NEGLIGIBLE
) -> BaseParameters:
    """The base parameters that ``columns`` (rows, p), rows >> p, can identify.

    ``order``: indices of columns, those that had better stand for a group first; the default is
    ``reading_order(names)``. ``negligible``: share of a column that, left over by the earlier ones, counts as nothing;
    for measured columns the noise's.
    """
    triangle = triangle_of(columns)
    size = np.linalg.norm(triangle, axis=0)
    seen = size > NEGLIGIBLE * size.max(initial=1e-300)
    wanted = np.array(
        [column for column in (reading_order(tuple(names)) if order is None else order) if seen[column]], np.intp
    )
    scaled = triangle[:, wanted] / size[wanted]
    pivoted, turned = pivoted_triangle(scaled)
    pivots = np.abs(np.diag(pivoted))
    rank = int(np.sum(pivots > negligible * max(pivots.max(initial=0.0), 1e-300)))
    scaled = np.empty((rank, len(wanted)))  # rows beyond the rank hold rounding errors only
    scaled[:, turned] = pivoted[:rank]
    standing = _first_independent(scaled, negligible)
    kept, others = wanted[standing], np.delete(wanted, standing)

    # R of [kept others] = [Rk Ro], and others = kept Rk^-1 Ro.
    both = triangle_of(np.concatenate([scaled[:, standing], np.delete(scaled, standing, axis=1)], axis=1))
    both = both[: len(kept)]
    grouping = np.zeros((len(kept), len(size)))
    if len(kept):
        made = lapack.dtrtrs(both[:, : len(kept)], both[:, len(kept) :])[0]
        grouping[:, others] = made * size[others] / size[kept][:, None]
    grouping[np.abs(grouping) < 1e-7] = 0.0
    grouping[:, kept] = np.eye(len(kept))
    return BaseParameters(tuple(names), kept, grouping)


def _first_independent(columns: Array, negligible: float) -> NDArray[np.intp]:
    """Indices of the columns (of unit size) of which more than ``negligible`` is left beyond all before them.

    What an unpivoted QR decomposition keeps up to the first column with nothing left of it; then once more on what is
    left of the rest.
    """
    found, rest = [], np.arange(columns.shape[1])
    while columns.size:
        alive = np.linalg.norm(columns, axis=0) > negligible
        columns, rest = columns[:, alive], rest[alive]
        triangle = triangle_of(columns)
        small = np.flatnonzero(np.abs(np.diag(triangle)) <= negligible)
        good = small[0] if len(small) else min(triangle.shape)
        found.append(rest[:good])
        columns, rest = triangle[good:, good:], rest[good:]
    return np.concatenate(found) if found else rest


@cache
def reading_order(names: tuple[str, ...]) -> list[int]:
    """Columns in the order in which parameters are listed and kept: drives first, then links from the tip inwards.

    Those that are usually grouped into the next link inwards come last: iyy, mz, mass; then effects.
    """
    last = {"iyy": 1, "mz": 2, "mass": 3}
    within = {"mx": 0, "my": 1, "izz": 2, "ixx": 3}

    def rank(index: int) -> tuple[int, int, int, int]:
        head, _, quantity = names[index].partition(".")
        if is_effect(names[index]):
            return (2, 0, index, 0)
        number = int("".join(c for c in head if c.isdigit()) or 0)
        if head.startswith("link"):
            return (1, last.get(quantity, 0), -number, within.get(quantity, 4))
        return (0, 0, number, 0)

    return sorted(range(len(names)), key=rank)


def structural_base(arm: Arm, friction: Friction = "symmetric", *, negligible: float = NEGLIGIBLE) -> BaseParameters:
    """What any motion of this arm could show: base parameters from random states within its limits.

    Columns of effects depend on the other parameters, so that arms with other bodies decide too (``_generic_arms``).
    negligible as ``base_parameters`` has it.
    """
    # A smooth sign would make Coulomb friction per direction and an offset distinguishable: use a sharp one.
    arm = arm.with_sign_velocities(np.full(len(arm), 1e-7))
    names = column_names(arm, friction)
    random, count = np.random.default_rng(1), 4 * len(names)
    limits = [joint.limits or ((-np.pi, np.pi) if joint.revolute else (-1.0, 1.0)) for joint in arm.joints]
    q = random.uniform([low for low, _ in limits], [high for _, high in limits], (count, len(arm)))
    qd, qdd = random.uniform(-2, 2, q.shape), random.uniform(-5, 5, q.shape)
    for j, joint in enumerate(arm.joints):
        if joint.friction_curve is not None:  # most of its speeds are low
            speed = np.array([0.0, *joint.friction_curve.speed, 2 * joint.friction_curve.speed[-1]])
            qd[:, j] = np.sign(qd[:, j]) * np.interp(random.uniform(size=count), np.linspace(0, 1, len(speed)), speed)
    t = random.uniform(0.0, 60.0, count)
    arm = replace(arm, temperatures=_any_temperatures(arm, random))
    columns = [model_columns(one, q, qd, qdd, friction, t) for one in _generic_arms(arm, random)]
    # a joint that lifts is described by masses and rotors rather than by its offset
    last = {f"joint{j + 1}.offset" for j in range(len(arm)) if lifts(arm, j)}
    order = sorted(reading_order(tuple(names)), key=lambda column: names[column] in last)
    return base_parameters(np.concatenate(columns).reshape(-1, len(names)), names, order=order, negligible=negligible)


def _generic_arms(arm: Arm, random: np.random.Generator) -> Iterator[Arm]:
    """The arm itself; of one with effects, GENERIC_ARMS more with bodies and effects of other sizes.

    The columns of effects depend on the other parameters: a wrist coupling is felt by what the coupled links weigh, so
    that in front of a link that the model has as massless its column is zero, though the real arm's is not.
    """
    yield arm
    for _ in range(GENERIC_ARMS if arm.effects else 0):
        mean = float(np.mean(arm.joint_array("mass"))) or 1.0
        other = replace(arm, joints=tuple(_other_body(joint, mean, random) for joint in arm.joints))
        sizes = {
            name: parameter(arm, name) + random.uniform(0.3, 1.0) * definition(name).typical[1]
            for name in effect_parameters(arm)
        }
        yield with_parameters(other, sizes)


def _other_body(joint: Joint, mean: float, random: np.random.Generator) -> Joint:
    """A joint with a body of some ``mean`` kg behind it."""
    mass = mean * random.uniform(0.5, 1.5)
    x, y, z = (random.uniform(0.5, 1.0, 3) * mass * SIZE**2).tolist()
    com = tuple((np.array(joint.com) + SIZE * random.uniform(-1.0, 1.0, 3)).tolist())
    # triangle inequality of principal inertias: sums of two halves each
    return replace(joint, mass=mass, com=com, inertia=(y + z, x + z, x + y, 0.0, 0.0, 0.0))


def _any_temperatures(arm: Arm, random: np.random.Generator) -> Temperatures:
    """Of motors that warm up and cool down within the minute of ``structural_base``, each in its own way."""
    usual = [joint.temperature or 0.0 for joint in arm.joints]
    courses = tuple(tuple((one + random.uniform(-20.0, 20.0, 6)).tolist()) for one in usual)
    return Temperatures(tuple(np.linspace(0.0, 60.0, 6).tolist()), courses)
