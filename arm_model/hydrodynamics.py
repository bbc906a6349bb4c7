"""What water adds to the torques of an arm: Morison's equation on strips of its links, and in closed form for two links in a plane.

A strip dl of a cylinder of radius R, with the velocity v and acceleration a of its centre normal to the cylinder's axis, is held back by

    dF = (rho C_d R |v| v + rho C_a pi R^2 a + rho pi R^2 g) dl          drag, added mass; buoyancy, with the whole of gravity g

in water at rest (Morison et al., "The force exerted by surface waves on piles", Petroleum Trans. AIME 189, 1950). Flow along the
axis and round the ends does nothing. C_a is the coefficient of a_n; potential flow has 1, the thesis's arm 2. Torques here are
what the drives must give in addition, N m (N) at the joints; shapes (N, n) as in ``arm_model.dynamics``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_model import newton_euler
from arm_model.description import Arm
from arm_model.dynamics import inverse_dynamics
from arm_model.kinematics import placement
from arm_model.rigid_body import mass_matrix, samples
from inputs import InputError

Array = NDArray[np.float64]
Torque = Callable[[Array, Array, Array], Array]
"""(q, qd, qdd), (N, n) each -> (N, n) torque, affine in qdd."""


@dataclass(frozen=True)
class Water:
    """density kg/m3; drag and added mass coefficients C_d and C_a of a cylinder across its axis."""

    density: float = 1025.0
    drag: float = 1.0
    added_mass: float = 2.0

    def drag_per_length(self, radius: float) -> float:
        """rho C_d R: drag over length and squared velocity, kg/m2."""
        return self.density * self.drag * radius

    def mass_per_length(self, radius: float) -> float:
        """rho C_a pi R^2, kg/m."""
        return self.density * self.added_mass * np.pi * radius**2


@dataclass(frozen=True)
class Cylinder:
    """The body of one link (from 1) as the water meets it: from start to end, m in the link's frame, radius m."""

    link: int
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


def cylinder_along(arm: Arm, link: int, radius: float) -> Cylinder:
    """A cylinder from where the link's joint sits to the origin of the link's frame."""
    after = placement(arm.joints[link - 1])[1]
    x, y, z = (float(value) for value in -after[:3, :3].T @ after[:3, 3])
    return Cylinder(link, (x, y, z), (0.0, 0.0, 0.0), radius)


def strip_torque(
    arm: Arm,
    cylinders: Sequence[Cylinder],
    water: Water,
    q: Array,
    qd: Array,
    qdd: Array,
    *,
    strips: int = 50,
    buoyancy: bool = True,
) -> Array:
    """(N, n) torque of any arm in water, ``strips`` of equal length to a cylinder; the error falls with their square."""
    q, qd, qdd = samples(arm, q, qd, qdd)
    chain = newton_euler.chain_of(arm)
    turn = newton_euler.turns(chain, list(q.T), np.cos, np.sin)
    still, none = [0.0] * len(arm), (0.0, 0.0, 0.0)
    # With all speeds zero, accelerations are J q''; with q' in the place of q'' that is the velocities.
    velocities = newton_euler.motions(chain, turn, list(q.T), still, list(qd.T), none)
    moving = newton_euler.motions(chain, turn, list(q.T), list(qd.T), list(qdd.T), none)
    weights = newton_euler.motions(chain, turn, list(q.T), still, still, arm.gravity)
    count = len(q)
    force, moment = np.zeros((len(arm), count, 3)), np.zeros((len(arm), count, 3))
    for cylinder in cylinders:
        if not 1 <= cylinder.link <= len(arm):
            raise InputError(arm.name, f"has no link {cylinder.link} for a cylinder; 1 to {len(arm)} are there")
        j = cylinder.link - 1
        centres, axis, length = _strips(cylinder, chain.link[j], strips)
        speed = _origin(velocities[j], count) + np.cross(_triple(velocities[j].spin_rate, count), centres)
        turned = np.stack([_triple(row, count)[:, 0] for row in moving[j].gyration], axis=1)  # (N, 3, 3)
        acceleration = _origin(moving[j], count) + centres @ np.swapaxes(turned, 1, 2)
        across = np.eye(3) - np.outer(axis, axis)
        normal, accelerated = speed @ across, acceleration @ across
        resisted = water.drag_per_length(cylinder.radius) * np.linalg.norm(normal, axis=-1, keepdims=True) * normal
        resisted = resisted + water.mass_per_length(cylinder.radius) * accelerated
        if buoyancy:  # the base accelerates at -g in ``weights``
            resisted = resisted - water.density * np.pi * cylinder.radius**2 * _origin(weights[j], count)
        force[j] += length * resisted.sum(axis=1)
        moment[j] += length * np.cross(centres, resisted).sum(axis=1)
    wrenches = [(tuple(force[j].T), tuple(moment[j].T)) for j in range(len(arm))]
    return np.stack(newton_euler.torques(chain, turn, list(q.T), wrenches), axis=-1)


def strip_regressor(
    arm: Arm, cylinders: Sequence[Cylinder], density: float, q: Array, qd: Array, qdd: Array, *, strips: int = 50
) -> Array:
    """(N, n, 2) torque per unit of C_d and of C_a, which it is linear in: columns to estimate them by. No buoyancy."""
    columns = [
        strip_torque(arm, cylinders, water, q, qd, qdd, strips=strips, buoyancy=False)
        for water in (Water(density, 1.0, 0.0), Water(density, 0.0, 1.0))
    ]
    return np.stack(columns, axis=-1)


def _strips(cylinder: Cylinder, link: Array, strips: int) -> tuple[Array, Array, float]:
    """(S, 3) centres and (3,) axis in the joint frame, and the length of a strip, m; ``link``: link frame in joint frame."""
    start, end = (link[:3, :3] @ np.array(point) + link[:3, 3] for point in (cylinder.start, cylinder.end))
    length = float(np.linalg.norm(end - start))
    if length == 0.0:
        raise InputError(f"cylinder of link {cylinder.link}", "starts where it ends; two different points are wanted")
    share = (np.arange(strips) + 0.5) / strips
    return start + share[:, None] * (end - start), (end - start) / length, length / strips


def _triple(vector: newton_euler.Triple, count: int) -> Array:
    """(N, 1, 3) of a vector whose entries are numbers or (N,) arrays."""
    return np.stack([np.broadcast_to(np.asarray(x, float), count) for x in vector], axis=-1)[:, None]


def _origin(motion: newton_euler.Motion, count: int) -> Array:
    return _triple(motion.acceleration, count)


@dataclass(frozen=True)
class TwoLinks:
    """Two cylinders in a plane, revolute joints at right angles to it, q2 = 0 stretched; lengths m, radius m."""

    lengths: tuple[float, float]
    radius: float

    def reversal(self, q: Array, qd: Array) -> Array:
        """(N,) m from joint 2, where the flow across link 2 changes its sign: l0 = -q1' l1 cos q2 / (q1' + q2'); beyond
        0..l2, or not finite, where it does not."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(-qd[:, 0] * self.lengths[0] * np.cos(q[:, 1]) / (qd[:, 0] + qd[:, 1]))

    def drag(self, water: Water, q: Array, qd: Array) -> Array:
        """(N, 2) torque of the drag: of link 1 with its fourth power, of link 2 by cases.

        Across link 2 the velocity is v = a + w l, a = q1' l1 cos q2, w = q1' + q2'. Where it has one sign s, the integrals of |v| v
        and |v| v l are s P0(l2) and s P1(l2), P0 and P1 those of v^2 and v^2 l from 0; where it changes sign at l0, they are
        sign(a) P(l0) + sign(w) (P(l2) - P(l0)).
        """
        (l1, l2), k = self.lengths, water.drag_per_length(self.radius)
        a, w = qd[:, 0] * l1 * np.cos(q[:, 1]), qd[:, 0] + qd[:, 1]
        l0 = self.reversal(q, qd)
        reverse = (l0 > 0) & (l0 < l2)
        # without reversal: all of the link at the sign that its middle has
        before, behind = (np.where(reverse, np.sign(x), np.sign(a + w * l2 / 2)) for x in (a, w))
        split = np.where(reverse, l0, l2)

        def integral(weighted: int) -> Array:
            def power(l: Array | float) -> Array:
                n = weighted + 1
                return np.asarray(l**n * (a * a / n + 2 * a * w * l / (n + 1) + w * w * l * l / (n + 2)))

            return np.asarray(before * power(split) + behind * (power(l2) - power(split)))

        second = k * integral(1)
        first = k * np.abs(qd[:, 0]) * qd[:, 0] * l1**4 / 4 + k * l1 * np.cos(q[:, 1]) * integral(0) + second
        return np.stack([first, second], axis=-1)

    def added_mass(self, water: Water, q: Array, qd: Array, qdd: Array) -> Array:
        """(N, 2) torque of the added mass. Across link 2 the acceleration is A + W l with A = l1 (q1'' cos q2 + q1'^2 sin q2),
        W = q1'' + q2''."""
        (l1, l2), m = self.lengths, water.mass_per_length(self.radius)
        c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
        a, w = l1 * (qdd[:, 0] * c + qd[:, 0] ** 2 * s), qdd[:, 0] + qdd[:, 1]
        second = m * (a * l2**2 / 2 + w * l2**3 / 3)
        first = m * qdd[:, 0] * l1**3 / 3 + l1 * c * m * (a * l2 + w * l2**2 / 2) + second
        return np.stack([first, second], axis=-1)

    def torque(self, water: Water) -> Torque:
        """Both, as a function of q, qd, qdd."""
        return lambda q, qd, qdd: self.drag(water, q, qd) + self.added_mass(water, q, qd, qdd)


def accelerations(arm: Arm, around: Torque, q: Array, qd: Array, tau: Array) -> Array:
    """(N, n) accelerations of an arm under joint torques ``tau`` with ``around`` (the water's) to overcome as well."""
    q, qd, tau = samples(arm, q, qd, tau)
    n, none = len(arm), np.zeros_like(q)
    # affine in the acceleration: its value without one, and with each alone
    each = np.concatenate([none, *(none + row for row in np.eye(n))])
    water = around(np.tile(q, (n + 1, 1)), np.tile(qd, (n + 1, 1)), each).reshape(n + 1, *q.shape)
    matrix = mass_matrix(arm, q) + np.moveaxis(water[1:] - water[0], 0, -1)
    right = tau - inverse_dynamics(arm, q, qd, none) - water[0]
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], float)
