"""The recursive Newton-Euler equations, once, for numbers, arrays and symbols alike.

Luh, Walker, Paul, "On-line computational scheme for mechanical manipulators", J. DSMC 102, 1980; the mass matrix by
composite bodies: Walker and Orin, J. DSMC 104, 1982. Everything is written in the JOINT frames: frame j of this file
has its z axis along joint j's axis and moves with link j. ``Chain`` holds the constants; the variable entries are
scalars of any kind that adds and multiplies: floats, (N,) arrays of N samples, expressions of
``arm_model.symbolic.tape``, sympy symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm, Joint
from arm_model.rigid_body.kinematics import placement
from arm_model.rigid_body.scalar import Scalar
from arm_model.rigid_body.vectors import Triple, add, apply, cross, dot, floats, mul, plus, sub
from arm_model.tables.fields import Pose

Body = tuple[Scalar, ...]
"""mass, mx, my, mz, ixx, ixy, ixz, iyy, iyz, izz about the origin of the joint frame, in it."""


@dataclass(frozen=True)
class Chain:
    """Constants of the recursion. joint frame j in joint frame j-1 is (rotation[j], shift[j]) and then J(q_j)."""

    revolute: tuple[bool, ...]
    rotation: tuple[Array, ...]  # (3, 3) each
    shift: tuple[Array, ...]  # (3,) each, m
    link: tuple[Array, ...]  # (4, 4) each: link frame j in joint frame j

    def __len__(self) -> int:
        return len(self.revolute)


def chain_of(arm: Arm) -> Chain:
    """The chain of an arm; frame 0 is the base frame, in which gravity is given."""
    return chain_from(arm.base, arm.joints)


@lru_cache(maxsize=32)  # every evaluation of the dynamics asks for it
def chain_from(base: Pose, joints: tuple[Joint, ...]) -> Chain:
    """The chain of joints on a base; not to be written to: the same is handed to everybody who asks."""
    rotation, shift, link = [], [], []
    last = np.array(base)
    for joint in joints:
        before, after = placement(joint)
        pose = last @ before
        rotation.append(pose[:3, :3])
        shift.append(pose[:3, 3])
        link.append(after)
        last = after
    return Chain(tuple(joint.revolute for joint in joints), tuple(rotation), tuple(shift), tuple(link))


def into(rotation: Array, turn: tuple[Scalar, Scalar], v: Triple) -> Triple:
    """A vector of the previous joint frame in this one: Rz(q)^T rotation^T v; ``turn`` is (cos q, sin q)."""
    x, y, z = (dot(floats(rotation[:, k]), v) for k in range(3))
    c, s = turn
    return add(mul(c, x), mul(s, y)), sub(mul(c, y), mul(s, x)), z


def back(rotation: Array, turn: tuple[Scalar, Scalar], v: Triple) -> Triple:
    """A vector of this joint frame in the previous one: rotation Rz(q) v."""
    c, s = turn
    turned = (sub(mul(c, v[0]), mul(s, v[1])), add(mul(s, v[0]), mul(c, v[1])), v[2])
    x, y, z = (dot(floats(rotation[k]), turned) for k in range(3))
    return x, y, z


@dataclass(frozen=True)
class Motion:
    """Motion of one link in its joint frame.

    Angular velocity, its rate, ``gyration`` = [w'x] + [wx][wx] (3 x 3), and the acceleration of the frame's origin less
    gravity.
    """

    spin: Triple
    spin_rate: Triple
    gyration: tuple[Triple, Triple, Triple]
    acceleration: Triple


def gyration(w: Triple, r: Triple) -> tuple[Triple, Triple, Triple]:
    """[r x] + [w x][w x]: what makes the acceleration of a fixed point of a body that turns with w, w' = r."""
    xy, xz, yz = mul(w[0], w[1]), mul(w[0], w[2]), mul(w[1], w[2])
    xx, yy, zz = mul(w[0], w[0]), mul(w[1], w[1]), mul(w[2], w[2])
    return (
        (sub(0.0, add(yy, zz)), sub(xy, r[2]), add(xz, r[1])),
        (add(xy, r[2]), sub(0.0, add(xx, zz)), sub(yz, r[0])),
        (sub(xz, r[1]), add(yz, r[0]), sub(0.0, add(xx, yy))),
    )


def turns(chain: Chain, q: Sequence[Scalar], cos: Any, sin: Any) -> list[tuple[Scalar, Scalar]]:
    """(cos q, sin q) of every joint, (1, 0) of prismatic ones."""
    return [(cos(q[j]), sin(q[j])) if chain.revolute[j] else (1.0, 0.0) for j in range(len(chain))]


def reach(chain: Chain, j: int, q: Scalar) -> Triple:
    """Origin of joint frame j in joint frame j-1."""
    x, y, z = floats(chain.shift[j])
    if chain.revolute[j]:
        return x, y, z
    along = floats(chain.rotation[j][:, 2])
    return add(x, mul(along[0], q)), add(y, mul(along[1], q)), add(z, mul(along[2], q))


def motions(
    chain: Chain,
    turn: Sequence[tuple[Scalar, Scalar]],
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    gravity: Sequence[Scalar],
    base: Motion | None = None,
) -> list[Motion]:
    """Outward recursion: the motion of every link.

    ``gravity`` (3,) m/s2 in the base frame enters as the base's acceleration. ``base``: motion of a moving base in its
    own frame, without gravity.
    """
    still: Triple = (0.0, 0.0, 0.0)
    falling = (sub(0.0, gravity[0]), sub(0.0, gravity[1]), sub(0.0, gravity[2]))
    if base is None:
        last = Motion(still, still, (still, still, still), falling)
    else:
        last = Motion(base.spin, base.spin_rate, base.gyration, plus(base.acceleration, falling))
    found = []
    for j in range(len(chain)):
        rotation = chain.rotation[j]
        spin = into(rotation, turn[j], last.spin)
        rate = into(rotation, turn[j], last.spin_rate)
        moved = plus(last.acceleration, apply(last.gyration, reach(chain, j, q[j])))
        acceleration = into(rotation, turn[j], moved)
        if chain.revolute[j]:
            rate = (add(rate[0], mul(spin[1], qd[j])), sub(rate[1], mul(spin[0], qd[j])), add(rate[2], qdd[j]))
            spin = (spin[0], spin[1], add(spin[2], qd[j]))
        else:
            twice = mul(2.0, qd[j])
            coriolis = (mul(spin[1], twice), sub(0.0, mul(spin[0], twice)), qdd[j])
            acceleration = plus(acceleration, coriolis)
        last = Motion(spin, rate, gyration(spin, rate), acceleration)
        found.append(last)
    return found


def jacobians(
    chain: Chain, turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar], links: int
) -> list[list[tuple[Triple, Triple]]]:
    """For each of the first ``links`` links: angular velocity and velocity of the origin of its joint frame.

    Both are in that frame, per unit rate of each joint up to the link's own.
    """
    last: list[tuple[Triple, Triple]] = []
    found = []
    for j in range(links):
        rotation, away = chain.rotation[j], reach(chain, j, q[j])
        here = [(into(rotation, turn[j], w), into(rotation, turn[j], plus(v, cross(w, away)))) for w, v in last]
        axis: Triple = (0.0, 0.0, 1.0)
        still: Triple = (0.0, 0.0, 0.0)
        last = [*here, (axis, still) if chain.revolute[j] else (still, axis)]
        found.append(last)
    return found


def wrench(body: Body, motion: Motion) -> tuple[Triple, Triple]:
    """Force and moment about the joint frame's origin that move ``body`` so."""
    mass, moment = body[0], (body[1], body[2], body[3])
    ixx, ixy, ixz, iyy, iyz, izz = body[4:]
    inertia = ((ixx, ixy, ixz), (ixy, iyy, iyz), (ixz, iyz, izz))
    a, w = motion.acceleration, motion.spin
    pushed = (mul(mass, a[0]), mul(mass, a[1]), mul(mass, a[2]))
    force = plus(pushed, apply(motion.gyration, moment))
    turned = plus(apply(inertia, motion.spin_rate), cross(w, apply(inertia, w)))
    return force, plus(turned, cross(moment, a))


def torques(
    chain: Chain, turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar], wrenches: list[tuple[Triple, Triple]]
) -> list[Scalar]:
    """Inward recursion: joint torques (N m; N) that give every link its wrench."""
    n = len(chain)
    tau: list[Scalar] = [0.0] * n
    force: Triple = (0.0, 0.0, 0.0)
    moment: Triple = (0.0, 0.0, 0.0)
    for j in reversed(range(n)):
        force, moment = plus(wrenches[j][0], force), plus(wrenches[j][1], moment)
        tau[j] = moment[2] if chain.revolute[j] else force[2]
        if j:
            moment = back(chain.rotation[j], turn[j], moment)
            force = back(chain.rotation[j], turn[j], force)
            moment = plus(moment, cross(reach(chain, j, q[j]), force))
    return tau


def inverse_dynamics(
    chain: Chain,
    bodies: Sequence[Body],
    turn: Sequence[tuple[Scalar, Scalar]],
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    gravity: Sequence[Scalar],
) -> list[Scalar]:
    """Joint torques (N m; N) of the rigid links."""
    moving = motions(chain, turn, q, qd, qdd, gravity)
    return torques(chain, turn, q, [wrench(body, motion) for body, motion in zip(bodies, moving)])


def unit_torques(
    chain: Chain,
    units: Sequence[Sequence[Body]],
    turn: Sequence[tuple[Scalar, Scalar]],
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    gravity: Sequence[Scalar],
) -> list[list[list[Scalar]]]:
    """Joint torques (N m; N) that ``units``, bodies of each link, ask for: [joint][link - joint][body].

    By the velocities of a link that a joint makes, which are the lever of the wrench on it (virtual work).
    """
    moving, levers = motions(chain, turn, q, qd, qdd, gravity), jacobians(chain, turn, q, len(chain))
    found: list[list[list[Scalar]]] = [[] for _ in range(len(chain))]
    for bodies, motion, of_joints in zip(units, moving, levers):
        wrenches = [wrench(body, motion) for body in bodies]
        for torque, (spin, velocity) in zip(found, of_joints):
            torque.append([add(dot(spin, moment), dot(velocity, force)) for force, moment in wrenches])
    return found


def _carried(chain: Chain, j: int, turn: tuple[Scalar, Scalar], q: Scalar, body: Body) -> Body:
    """``body`` of joint frame j about and in joint frame j-1."""
    mass, ixx, ixy, ixz, iyy, iyz, izz = body[0], *body[4:]
    c, s = turn
    cs, ss = mul(c, s), mul(s, s)
    u = sub(mul(ss, sub(iyy, ixx)), mul(mul(2.0, cs), ixy))
    xy = add(mul(cs, sub(ixx, iyy)), mul(sub(1.0, mul(2.0, ss)), ixy))
    xz, yz = sub(mul(c, ixz), mul(s, iyz)), add(mul(s, ixz), mul(c, iyz))
    turned = ((add(ixx, u), xy, xz), (xy, sub(iyy, u), yz), (xz, yz, izz))
    rows = [floats(chain.rotation[j][k]) for k in range(3)]
    half = [tuple(dot(rows[i], (turned[0][k], turned[1][k], turned[2][k])) for k in range(3)) for i in range(3)]
    inertia = [[dot(half[i], rows[k]) for k in range(3)] for i in range(3)]
    m = back(chain.rotation[j], turn, (body[1], body[2], body[3]))
    p = reach(chain, j, q)
    # parallel axis for a first moment m and a mass: I + 2 (m.p) 1 - m p^T - p m^T + mass ((p.p) 1 - p p^T)
    n = tuple(add(m[k], mul(mul(0.5, mass), p[k])) for k in range(3))
    trace = mul(2.0, dot(n, p))

    def entry(i: int, k: int) -> Scalar:
        mixed = add(mul(n[i], p[k]), mul(p[i], n[k]))
        return sub(add(inertia[i][k], trace) if i == k else inertia[i][k], mixed)

    upper = [entry(i, k) for i, k in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    return mass, *(add(m[k], mul(mass, p[k])) for k in range(3)), *upper


def mass_matrix(
    chain: Chain, bodies: Sequence[Body], turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar]
) -> list[list[Scalar]]:
    """The n x n mass matrix of the rigid links, by composite bodies."""
    n = len(chain)
    matrix: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    composite = list(bodies)
    for j in reversed(range(n)):
        mass, mx, my, _ = composite[j][:4]
        _, _, ixz, _, iyz, izz = composite[j][4:]
        if chain.revolute[j]:
            force, moment = (sub(0.0, my), mx, 0.0), (ixz, iyz, izz)
            matrix[j][j] = izz
        else:
            force, moment = (0.0, 0.0, mass), (my, sub(0.0, mx), 0.0)
            matrix[j][j] = mass
        for i in reversed(range(j)):
            moment = back(chain.rotation[i + 1], turn[i + 1], moment)
            force = back(chain.rotation[i + 1], turn[i + 1], force)
            moment = plus(moment, cross(reach(chain, i + 1, q[i + 1]), force))
            matrix[i][j] = matrix[j][i] = moment[2] if chain.revolute[i] else force[2]
        if j:
            carried = _carried(chain, j, turn[j], q[j], composite[j])
            composite[j - 1] = tuple(add(a, b) for a, b in zip(composite[j - 1], carried))
    return matrix
