"""A base that moves in all six degrees of freedom, by the same recursions as a fixed one.

Two ideas let the equations of ``newton_euler`` and ``hydrodynamics`` serve unchanged:

* The base is six joints before the arm, standing at zero: three that slide along x, y, z and three that turn about
  x, y, z. At zero the rates of these joints are the base's velocity in its own body frame, so that Jacobians, mass
  matrix and the inward recursion give its wrench and the coupling with the arm. Their constants are zeros and ones, of
  which nothing is left in generated equations.
* The outward recursion starts with the motion of the base itself rather than with these joints' rates: the rates of
  its velocity are those of body-frame components (quasi-velocities), v' + w x v being the acceleration of the origin.
  No angle of the base enters, and no attitude is singular. Gravity comes in the body frame.

Generalised velocity: (v, w, q'), six of the base (``arm_model.tables.floating_base``), then the joints. Water round the
base (Fossen 2021, chapters 6 and 8), as the wrench that overcomes it: with p = A11 v + A12 w, h = A21 v + A22 w of the
added mass A

    A (v', w') + (w x p, w x h + v x p)  +  (linear + quadratic |v|) v per degree of freedom  +  displaced weight
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm_model.description import Arm, Joint
from arm_model.rigid_body import hydrodynamics, newton_euler, scalar
from arm_model.rigid_body.newton_euler import Body, Chain, Motion, chain_from, chain_of
from arm_model.rigid_body.scalar import Scalar
from arm_model.rigid_body.vectors import Triple, add, cross, dot, mul, plus, sub
from arm_model.tables.fields import IDENTITY

DOF = 6
STILL: Triple = (0.0, 0.0, 0.0)
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_JOINTS = tuple(
    Joint(type=kind, convention="placed", axis=axis) for kind in ("prismatic", "revolute") for axis in _AXES
)
_NOTHING: Body = (0.0,) * 10


def chain_with_base(arm: Arm) -> Chain:
    """The chain of six joints of the base and the joints of the arm; its last base joint frame is the body frame."""
    base, links = chain_from(IDENTITY, _JOINTS), chain_of(arm)
    return Chain(
        base.revolute + links.revolute, base.rotation + links.rotation, base.shift + links.shift, base.link + links.link
    )


@dataclass(frozen=True)
class BaseMotion:
    """Velocity (v, w) of the base and its rate, body frame, and gravity in the body frame, m/s2."""

    velocity: Sequence[Scalar]
    rate: Sequence[Scalar]
    gravity: Triple

    def start(self) -> Motion:
        """Motion of the body frame, gravity apart."""
        v, w = _halves(self.velocity)
        linear, turning = _halves(self.rate)
        return Motion(w, turning, newton_euler.gyration(w, turning), plus(linear, cross(w, v)))


@dataclass(frozen=True)
class Configuration:
    """An arm on a moving base: its chains, and (cos q, sin q) and q of its joints (n)."""

    links: Chain
    whole: Chain
    turn: Sequence[tuple[Scalar, Scalar]]
    q: Sequence[Scalar]

    @property
    def all_turns(self) -> list[tuple[Scalar, Scalar]]:
        """(cos, sin) of the six joints of the base, which are 0, and of the arm."""
        return [(1.0, 0.0)] * DOF + list(self.turn)

    @property
    def all_q(self) -> list[Scalar]:
        """Angles of the six joints of the base, which are 0, and of the arm."""
        return [0.0] * DOF + list(self.q)


def _halves(six: Sequence[Scalar]) -> tuple[Triple, Triple]:
    return (six[0], six[1], six[2]), (six[3], six[4], six[5])


def forces(
    at: Configuration,
    base: Body,
    bodies: Sequence[Body],
    wet: hydrodynamics.Bodies,
    motion: BaseMotion,
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
) -> list[Scalar]:
    """(6 + n) wrench on the base (body frame) and joint torques that move the rigid bodies so in the water.

    ``base``: its inertial parameters about the body frame's origin; ``wet``: cylinders of the links, from 0, in their
    joint frames. Neither the water round the base nor its thrusters are in it.
    """
    start = motion.start()
    links = newton_euler.motions(at.links, at.turn, at.q, qd, qdd, motion.gravity, start)
    falling = Motion(start.spin, start.spin_rate, start.gyration, plus(start.acceleration, _minus(motion.gravity)))
    wrenches = [(STILL, STILL)] * (DOF - 1) + [newton_euler.wrench(base, falling)]
    wrenches += [newton_euler.wrench(body, moving) for body, moving in zip(bodies, links)]
    total = newton_euler.torques(at.whole, at.all_turns, at.all_q, wrenches)
    if not wet:
        return total
    swept = newton_euler.motions(at.links, at.turn, at.q, qd, qdd, STILL, start)
    rates, moving = [*motion.velocity, *qd], [start] * DOF + swept
    water = hydrodynamics.swept(at.whole, _behind_base(wet), at.all_turns, at.all_q, rates, motion.gravity, moving)
    return [add(a, b) for a, b in zip(total, water)]


def _minus(v: Triple) -> Triple:
    return sub(0.0, v[0]), sub(0.0, v[1]), sub(0.0, v[2])


def _behind_base(wet: hydrodynamics.Bodies) -> hydrodynamics.Bodies:
    return {j + DOF: body for j, body in wet.items()}


def mass_matrix(at: Configuration, base: Body, bodies: Sequence[Body], wet: hydrodynamics.Bodies) -> list[list[Scalar]]:
    """(6 + n) x (6 + n) mass matrix of the rigid bodies and of the water round the links."""
    everything = [_NOTHING] * (DOF - 1) + [base, *bodies]
    rigid = newton_euler.mass_matrix(at.whole, everything, at.all_turns, at.all_q)
    added = hydrodynamics.mass_matrix(at.whole, _behind_base(wet), at.all_turns, at.all_q)
    return [[add(a, b) for a, b in zip(*rows)] for rows in zip(rigid, added)]


@dataclass(frozen=True)
class BaseWater:
    """Water round the base: added mass (6 x 6), linear and quadratic drag (6), displaced mass and its first moment."""

    added: Sequence[Sequence[Scalar]]
    linear: Sequence[Scalar]
    quadratic: Sequence[Scalar]
    displaced: Scalar
    moment: Triple


def water_wrench(water: BaseWater, motion: BaseMotion) -> list[Scalar]:
    """(6) wrench that overcomes the water round the base, its added mass included; body frame."""
    return [a + b for a, b in zip(added_wrench(water.added, motion), still_wrench(water, motion))]


def still_wrench(water: BaseWater, motion: BaseMotion) -> list[Scalar]:
    """(6) the part of ``water_wrench`` that is not added mass: drag and buoyancy."""
    lift = [*(mul(water.displaced, g) for g in motion.gravity), *cross(water.moment, motion.gravity)]
    drag = [
        mul(add(linear, mul(quadratic, scalar.absolute(v))), v)
        for linear, quadratic, v in zip(water.linear, water.quadratic, motion.velocity)
    ]
    return [add(a, b) for a, b in zip(lift, drag)]


def added_wrench(added: Sequence[Sequence[Scalar]], motion: BaseMotion) -> list[Scalar]:
    """(6) wrench that moves the added mass: Kirchhoff's equations in the body frame."""
    v, w = _halves(motion.velocity)
    p, h = _halves([_product(row, motion.velocity) for row in added])
    inertial = [_product(row, motion.rate) for row in added]
    turned = [*cross(w, p), *plus(cross(w, h), cross(v, p))]
    return [add(a, b) for a, b in zip(inertial, turned)]


def _product(row: Sequence[Scalar], six: Sequence[Scalar]) -> Scalar:
    first, second = _halves(row), _halves(six)
    return add(dot(first[0], second[0]), dot(first[1], second[1]))


def rotation(attitude: Sequence[Scalar]) -> tuple[Triple, Triple, Triple]:
    """Rows of the rotation matrix, body to world, of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = attitude
    twice = 2.0 / (w * w + x * x + y * y + z * z)
    xx, yy, zz = twice * x * x, twice * y * y, twice * z * z
    xy, xz, yz = twice * x * y, twice * x * z, twice * y * z
    wx, wy, wz = twice * w * x, twice * w * y, twice * w * z
    return (
        (1.0 - (yy + zz), xy - wz, xz + wy),
        (xy + wz, 1.0 - (xx + zz), yz - wx),
        (xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def into_body(rows: tuple[Triple, Triple, Triple], vector: Sequence[Scalar]) -> Triple:
    """A world vector in the body frame: R^T v."""
    x, y, z = (dot((rows[0][k], rows[1][k], rows[2][k]), vector) for k in range(3))
    return x, y, z


NORM_RATE = 1.0
"""1/s with which the length of the attitude quaternion returns to 1 where rounding and step errors changed it."""


def attitude_rate(attitude: Sequence[Scalar], w: Triple) -> list[Scalar]:
    """(4) rate of the quaternion (w, x, y, z), body to world, at the body-frame rate ``w``; its length returns to 1."""
    s, x, y, z = attitude
    back = NORM_RATE * (1.0 - (s * s + x * x + y * y + z * z))
    return [
        0.5 * (-(x * w[0]) - y * w[1] - z * w[2]) + back * s,
        0.5 * (s * w[0] + y * w[2] - z * w[1]) + back * x,
        0.5 * (s * w[1] + z * w[0] - x * w[2]) + back * y,
        0.5 * (s * w[2] + x * w[1] - y * w[0]) + back * z,
    ]


def water_of_base(arm: Arm) -> BaseWater:
    """The water round the base as the model file describes it."""
    base = arm.floating
    assert base is not None
    x, y, z = (float(base.displaced_mass * c) for c in base.buoyancy_centre)
    return BaseWater(base.added.tolist(), base.linear_drag, base.quadratic_drag, base.displaced_mass, (x, y, z))


def configuration(arm: Arm, turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar]) -> Configuration:
    """An arm on its floating base with its joints at q."""
    return Configuration(chain_of(arm), chain_with_base(arm), turn, q)
