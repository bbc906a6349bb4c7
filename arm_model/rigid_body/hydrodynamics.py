"""What water adds to the torques of an arm: Morison's equation on strips along the cylinders of its links.

A link in water is described by a ``Cylinder``.

A strip dl of a cylinder of radius R, with the velocity v and acceleration a of its centre across the cylinder's axis,
is held back by

    dF = (rho C_d R |v| v + rho C_a pi R^2 a + b rho pi R^2 g) dl          drag, added mass; buoyancy, b = 1 where it is
        immersed

in water at rest (Morison et al., "The force exerted by surface waves on piles", Petroleum Trans. AIME 189, 1950). Flow
along the axis and round the ends does nothing. C_a is the coefficient of a; potential flow has 1, the thesis's arm 2. v
and a are linear in the place along the cylinder: added mass and buoyancy are integrated exactly, and so is the drag of
a flow in one plane that does not turn round. Elsewhere the strips leave up to 2e-4 of the drag that the cylinder has at
the speed of its faster end.

Everything is written in the joint frames of ``arm_model.rigid_body.newton_euler``, and once, for arrays and tape
expressions alike; torques are what the drives must give in addition, N m (N) at the joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_model.description import Arm
from arm_model.rigid_body import scalar
from arm_model.rigid_body.newton_euler import Chain, Motion, chain_of, into, jacobians, motions
from arm_model.rigid_body.scalar import Scalar
from arm_model.rigid_body.vectors import Triple, add, apply, cross, dot, floats, mul, plus, sub
from arm_model.tables.link_shapes import Cylinder

STRIPS = 6
"""Strips of a cylinder, each with the two points of Gauss's rule."""


COEFFICIENTS = ("drag_coefficient", "added_mass_coefficient", "buoyancy")
"""What the torques are linear in, by its names in ``Cylinder``."""


@dataclass(frozen=True)
class Water:
    """What the water does to one cylinder; scalars of any kind.

    The fields are resistance rho C_d R, kg/m2; added mass rho C_a pi R^2, kg/m; displaced mass b rho pi R^2 L, kg.
    """

    resistance: Scalar
    added: Scalar
    displaced: Scalar


def unit_water(cylinder: Cylinder) -> Water:
    """The water for coefficients C_d, C_a and b of 1: what a column of the regressor is made of."""
    section = cylinder.density * np.pi * cylinder.radius**2
    length = float(np.linalg.norm(np.subtract(cylinder.end, cylinder.start)))
    return Water(cylinder.density * cylinder.radius, section, section * length)


def water_of(cylinder: Cylinder) -> Water:
    """The water as the model file describes it."""
    unit = unit_water(cylinder)
    return Water(
        unit.resistance * cylinder.drag_coefficient,
        unit.added * cylinder.added_mass_coefficient,
        unit.displaced * cylinder.buoyancy,
    )


@dataclass(frozen=True)
class Shape:
    """A cylinder in its link's joint frame.

    middle (3,) m, length m, and unit rows across (2) and along (1) its axis, which make a right-handed frame.
    """

    middle: Triple
    length: float
    across: tuple[Triple, Triple]
    along: Triple

    @property
    def turning(self) -> float:
        """Integral of the squared distance from the middle, m3."""
        return self.length**3 / 12


def shape_of(chain: Chain, j: int, cylinder: Cylinder) -> Shape:
    """The cylinder of link j (from 0)."""
    pose = chain.link[j]
    start, end = (pose[:3, :3] @ np.array(point) + pose[:3, 3] for point in (cylinder.start, cylinder.end))
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    # across the joint's axis where possible: what moves in a plane then stays in it
    upright = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
    second = upright - along * (along @ upright)
    second /= np.linalg.norm(second)
    rows = [np.cross(second, along), second, along, (start + end) / 2]
    first, second, axis, middle = (floats(np.where(np.abs(row) < 1e-14, 0.0, row)) for row in rows)
    return Shape(_triple(middle), length, (_triple(first), _triple(second)), _triple(axis))


def _triple(values: Sequence[float]) -> Triple:
    x, y, z = values
    return x, y, z


Bodies = Mapping[int, tuple[Shape, Water]]
"""Link (from 0) -> its cylinder and the water's coefficients."""


@dataclass(frozen=True)
class _Lever:
    """Motion of a cylinder per unit rate of one joint.

    Of its middle (3,) m/rad, across (2) and along its axis; and the two rates across by which points further along the
    axis are faster, 1/rad.
    """

    middle: Triple
    turn: tuple[Scalar, Scalar]


def _lever(shape: Shape, spin: Triple, origin: Triple) -> _Lever:
    first, second = shape.across
    middle = apply((first, second, shape.along), plus(origin, cross(spin, shape.middle)))
    # spin x along, in the right-handed frame of the cylinder
    return _Lever(middle, (dot(spin, second), sub(0.0, dot(spin, first))))


def _levers(
    chain: Chain, turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar], bodies: Bodies
) -> dict[int, list[_Lever]]:
    columns = jacobians(chain, turn, q, max(bodies, default=-1) + 1)
    return {j: [_lever(shape, *column) for column in columns[j]] for j, (shape, _) in bodies.items()}


def torques(
    chain: Chain,
    bodies: Bodies,
    turn: Sequence[tuple[Scalar, Scalar]],
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    gravity: Sequence[Scalar],
) -> list[Scalar]:
    """Joint torques (N m; N) that overcome the water; arguments as of ``newton_euler.inverse_dynamics``."""
    moving = motions(chain, turn, q, qd, qdd, (0.0, 0.0, 0.0)) if bodies else []
    return swept(chain, bodies, turn, q, qd, gravity, moving)


def swept(
    chain: Chain,
    bodies: Bodies,
    turn: Sequence[tuple[Scalar, Scalar]],
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    gravity: Sequence[Scalar],
    moving: Sequence[Motion],
) -> list[Scalar]:
    """``torques`` of links whose motions, gravity apart, are known: ``moving``, one per joint."""
    tau: list[Scalar] = [0.0] * len(chain)
    for j, levers in _levers(chain, turn, q, bodies).items():
        weight: Triple = (gravity[0], gravity[1], gravity[2])
        for k in range(j + 1):
            weight = into(chain.rotation[k], turn[k], weight)
        shape, water = bodies[j]
        force, moment = _wrench(shape, water, moving[j], weight, _drag(shape, levers, qd))
        for i, lever in enumerate(levers):
            tau[i] = add(tau[i], add(dot(lever.middle, force), _dot2(lever.turn, moment)))
    return tau


def _wrench(
    shape: Shape, water: Water, motion: Motion, weight: Triple, dragged: tuple[list[Scalar], list[Scalar]]
) -> tuple[list[Scalar], list[Scalar]]:
    """Force across (2) and along the cylinder, and the moments (2) that turn it, both about its middle.

    ``weight``: gravity in the joint frame, ``dragged``: the integrals of ``_drag``.
    """
    pulled = plus(motion.acceleration, apply(motion.gyration, shape.middle))
    turned = apply(motion.gyration, shape.along)
    force: list[Scalar] = [mul(water.displaced, part) for part in apply((*shape.across, shape.along), weight)]
    moment: list[Scalar] = [0.0, 0.0]
    for axis, row in enumerate(shape.across):
        added = mul(mul(water.added, shape.length), dot(row, pulled))
        force[axis] = add(add(force[axis], added), mul(water.resistance, dragged[0][axis]))
        added = mul(mul(water.added, shape.turning), dot(row, turned))
        moment[axis] = add(added, mul(water.resistance, dragged[1][axis]))
    return force, moment


def _drag(shape: Shape, levers: Sequence[_Lever], qd: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
    """Integrals of |v| v and of s |v| v along the cylinder, s from its middle; v across the axis (2)."""
    middle: list[Scalar] = [0.0, 0.0]
    slope: list[Scalar] = [0.0, 0.0]
    for lever, rate in zip(levers, qd):
        for axis in range(2):
            middle[axis] = add(middle[axis], mul(lever.middle[axis], rate))
            slope[axis] = add(slope[axis], mul(lever.turn[axis], rate))
    force: list[Scalar] = [0.0, 0.0]
    moment: list[Scalar] = [0.0, 0.0]
    for place, width in zip(*points(shape.length)):
        v = [add(middle[axis], mul(place, slope[axis])) for axis in range(2)]
        speed = scalar.sqrt(_dot2(v, v))
        for axis in range(2):
            part = mul(mul(width, speed), v[axis])
            force[axis] = add(force[axis], part)
            moment[axis] = add(moment[axis], mul(place, part))
    return force, moment


def points(length: float) -> tuple[list[float], list[float]]:
    """Distances from the middle, and weights, m, by which ``STRIPS`` strips of a cylinder are integrated.

    Each strip has two Gauss points.
    """
    width = length / STRIPS
    middles = (np.arange(STRIPS) - (STRIPS - 1) / 2) * width
    places = np.sort(np.concatenate([middles - width / np.sqrt(12), middles + width / np.sqrt(12)]))
    return places.tolist(), [width / 2] * (2 * STRIPS)


def _dot2(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    return add(mul(a[0], b[0]), mul(a[1], b[1]))


def mass_matrix(
    chain: Chain, bodies: Bodies, turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar]
) -> list[list[Scalar]]:
    """n x n: what the added mass adds to the mass matrix; symmetric, not negative."""
    n = len(chain)
    matrix: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    for j, levers in _levers(chain, turn, q, bodies).items():
        shape, water = bodies[j]
        mass, inertia = mul(water.added, shape.length), mul(water.added, shape.turning)
        for i in range(j + 1):
            for k in range(i + 1):
                along = mul(mass, _dot2(levers[i].middle, levers[k].middle))
                entry = add(along, mul(inertia, _dot2(levers[i].turn, levers[k].turn)))
                matrix[i][k] = add(matrix[i][k], entry)
                matrix[k][i] = matrix[i][k]
    return matrix


def bodies_of(arm: Arm) -> dict[int, tuple[Shape, Water]]:
    """The cylinders of an arm, in numbers."""
    chain = chain_of(arm)
    return {
        j: (shape_of(chain, j, joint.cylinder), water_of(joint.cylinder))
        for j, joint in enumerate(arm.joints)
        if joint.cylinder is not None
    }


def dry(arm: Arm) -> Arm:
    """The arm with nothing round its links."""
    return replace(arm, joints=tuple(replace(joint, cylinder=None, drag=None) for joint in arm.joints))


def own_drag(arm: Arm, joint: int) -> float:
    """N m s2/rad2 (N s2/m2) for C_d = 1.

    Drag of the cylinder of link ``joint`` (from 1) over q'^2 while its joint moves alone; 0 where it moves along
    itself, or the link has none.
    """
    cylinder = arm.joints[joint - 1].cylinder
    if cylinder is None:
        return 0.0
    chain = chain_of(arm)
    shape = shape_of(chain, joint - 1, cylinder)
    axis, still = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    lever = _lever(shape, axis, still) if chain.revolute[joint - 1] else _lever(shape, still, axis)
    force, moment = _drag(shape, [lever], [1.0])
    return unit_water(cylinder).resistance * float(_dot2(lever.middle, force) + _dot2(lever.turn, moment))
