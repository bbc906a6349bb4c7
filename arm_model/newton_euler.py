"""The recursive Newton-Euler equations, once, for numbers, arrays and symbols alike.

Luh, Walker, Paul, "On-line computational scheme for mechanical manipulators", J. DSMC 102, 1980; the mass matrix by composite
bodies: Walker and Orin, J. DSMC 104, 1982. Everything is written in the JOINT frames: frame j of this file has its z axis along
joint j's axis and moves with link j. ``Chain`` holds the constants; the variable entries are scalars of any kind that adds and
multiplies: floats, (N,) arrays of N samples, expressions of ``arm_model.tape``, sympy symbols. Products by the float 0 vanish,
which keeps the generated equations short and numpy from multiplying zeros.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from arm_model.kinematics import placement

Array = NDArray[np.float64]
Scalar = Any
Triple = tuple[Scalar, Scalar, Scalar]
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
    rotation, shift, link = [], [], []
    last = np.array(arm.base)
    for joint in arm.joints:
        before, after = placement(joint)
        pose = last @ before
        rotation.append(pose[:3, :3])
        shift.append(pose[:3, 3])
        link.append(after)
        last = after
    return Chain(tuple(joint.revolute for joint in arm.joints), tuple(rotation), tuple(shift), tuple(link))


def _mul(a: Scalar, b: Scalar) -> Scalar:
    for this, other in ((a, b), (b, a)):
        if isinstance(this, float):
            if this == 0.0:
                return 0.0
            if this == 1.0:
                return other
            if this == -1.0:
                return -other
    return a * b


def _add(a: Scalar, b: Scalar) -> Scalar:
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def _sub(a: Scalar, b: Scalar) -> Scalar:
    if isinstance(a, float) and a == 0.0:
        return -b
    return a if isinstance(b, float) and b == 0.0 else a - b


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    return _add(_add(_mul(a[0], b[0]), _mul(a[1], b[1])), _mul(a[2], b[2]))


def _cross(a: Triple, b: Triple) -> Triple:
    return (
        _sub(_mul(a[1], b[2]), _mul(a[2], b[1])),
        _sub(_mul(a[2], b[0]), _mul(a[0], b[2])),
        _sub(_mul(a[0], b[1]), _mul(a[1], b[0])),
    )


def _plus(a: Triple, b: Triple) -> Triple:
    return _add(a[0], b[0]), _add(a[1], b[1]), _add(a[2], b[2])


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _into(rotation: Array, turn: tuple[Scalar, Scalar], v: Triple) -> Triple:
    """A vector of the previous joint frame in this one: Rz(q)^T rotation^T v; ``turn`` is (cos q, sin q)."""
    x, y, z = (_dot(_floats(rotation[:, k]), v) for k in range(3))
    c, s = turn
    return _add(_mul(c, x), _mul(s, y)), _sub(_mul(c, y), _mul(s, x)), z


def _back(rotation: Array, turn: tuple[Scalar, Scalar], v: Triple) -> Triple:
    """A vector of this joint frame in the previous one: rotation Rz(q) v."""
    c, s = turn
    turned = (_sub(_mul(c, v[0]), _mul(s, v[1])), _add(_mul(s, v[0]), _mul(c, v[1])), v[2])
    x, y, z = (_dot(_floats(rotation[k]), turned) for k in range(3))
    return x, y, z


@dataclass(frozen=True)
class Motion:
    """Motion of one link in its joint frame: angular velocity, its rate, ``gyration`` = [w'x] + [wx][wx] (3 x 3), and the
    acceleration of the frame's origin less gravity."""

    spin: Triple
    spin_rate: Triple
    gyration: tuple[Triple, Triple, Triple]
    acceleration: Triple


def _gyration(w: Triple, r: Triple) -> tuple[Triple, Triple, Triple]:
    xy, xz, yz = _mul(w[0], w[1]), _mul(w[0], w[2]), _mul(w[1], w[2])
    xx, yy, zz = _mul(w[0], w[0]), _mul(w[1], w[1]), _mul(w[2], w[2])
    return (
        (_sub(0.0, _add(yy, zz)), _sub(xy, r[2]), _add(xz, r[1])),
        (_add(xy, r[2]), _sub(0.0, _add(xx, zz)), _sub(yz, r[0])),
        (_sub(xz, r[1]), _add(yz, r[0]), _sub(0.0, _add(xx, yy))),
    )


def _apply(matrix: Sequence[Triple], v: Triple) -> Triple:
    return _dot(matrix[0], v), _dot(matrix[1], v), _dot(matrix[2], v)


def turns(chain: Chain, q: Sequence[Scalar], cos: Any, sin: Any) -> list[tuple[Scalar, Scalar]]:
    """(cos q, sin q) of every joint, (1, 0) of prismatic ones."""
    return [(cos(q[j]), sin(q[j])) if chain.revolute[j] else (1.0, 0.0) for j in range(len(chain))]


def _reach(chain: Chain, j: int, q: Scalar) -> Triple:
    """Origin of joint frame j in joint frame j-1."""
    x, y, z = _floats(chain.shift[j])
    if chain.revolute[j]:
        return x, y, z
    along = _floats(chain.rotation[j][:, 2])
    return _add(x, _mul(along[0], q)), _add(y, _mul(along[1], q)), _add(z, _mul(along[2], q))


def motions(
    chain: Chain,
    turn: Sequence[tuple[Scalar, Scalar]],
    q: Sequence[Scalar],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    gravity: Sequence[Scalar],
) -> list[Motion]:
    """Outward recursion: the motion of every link. ``gravity`` (3,) m/s2 in the base frame enters as the base's acceleration."""
    still: Triple = (0.0, 0.0, 0.0)
    falling = (_sub(0.0, gravity[0]), _sub(0.0, gravity[1]), _sub(0.0, gravity[2]))
    last, found = Motion(still, still, (still, still, still), falling), []
    for j in range(len(chain)):
        rotation = chain.rotation[j]
        spin = _into(rotation, turn[j], last.spin)
        rate = _into(rotation, turn[j], last.spin_rate)
        moved = _plus(last.acceleration, _apply(last.gyration, _reach(chain, j, q[j])))
        acceleration = _into(rotation, turn[j], moved)
        if chain.revolute[j]:
            rate = (_add(rate[0], _mul(spin[1], qd[j])), _sub(rate[1], _mul(spin[0], qd[j])), _add(rate[2], qdd[j]))
            spin = (spin[0], spin[1], _add(spin[2], qd[j]))
        else:
            twice = _mul(2.0, qd[j])
            coriolis = (_mul(spin[1], twice), _sub(0.0, _mul(spin[0], twice)), qdd[j])
            acceleration = _plus(acceleration, coriolis)
        last = Motion(spin, rate, _gyration(spin, rate), acceleration)
        found.append(last)
    return found


def wrench(body: Body, motion: Motion) -> tuple[Triple, Triple]:
    """Force and moment about the joint frame's origin that move ``body`` so."""
    mass, moment = body[0], (body[1], body[2], body[3])
    ixx, ixy, ixz, iyy, iyz, izz = body[4:]
    inertia = ((ixx, ixy, ixz), (ixy, iyy, iyz), (ixz, iyz, izz))
    a, w = motion.acceleration, motion.spin
    pushed = (_mul(mass, a[0]), _mul(mass, a[1]), _mul(mass, a[2]))
    force = _plus(pushed, _apply(motion.gyration, moment))
    turned = _plus(_apply(inertia, motion.spin_rate), _cross(w, _apply(inertia, w)))
    return force, _plus(turned, _cross(moment, a))


def torques(
    chain: Chain, turn: Sequence[tuple[Scalar, Scalar]], q: Sequence[Scalar], wrenches: list[tuple[Triple, Triple]]
) -> list[Scalar]:
    """Inward recursion: joint torques (N m; N) that give every link its wrench."""
    n = len(chain)
    tau: list[Scalar] = [0.0] * n
    force: Triple = (0.0, 0.0, 0.0)
    moment: Triple = (0.0, 0.0, 0.0)
    for j in reversed(range(n)):
        force, moment = _plus(wrenches[j][0], force), _plus(wrenches[j][1], moment)
        tau[j] = moment[2] if chain.revolute[j] else force[2]
        if j:
            moment = _back(chain.rotation[j], turn[j], moment)
            force = _back(chain.rotation[j], turn[j], force)
            moment = _plus(moment, _cross(_reach(chain, j, q[j]), force))
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


def _carried(chain: Chain, j: int, turn: tuple[Scalar, Scalar], q: Scalar, body: Body) -> Body:
    """``body`` of joint frame j about and in joint frame j-1."""
    mass, ixx, ixy, ixz, iyy, iyz, izz = body[0], *body[4:]
    c, s = turn
    cs, ss = _mul(c, s), _mul(s, s)
    u = _sub(_mul(ss, _sub(iyy, ixx)), _mul(_mul(2.0, cs), ixy))
    xy = _add(_mul(cs, _sub(ixx, iyy)), _mul(_sub(1.0, _mul(2.0, ss)), ixy))
    xz, yz = _sub(_mul(c, ixz), _mul(s, iyz)), _add(_mul(s, ixz), _mul(c, iyz))
    turned = ((_add(ixx, u), xy, xz), (xy, _sub(iyy, u), yz), (xz, yz, izz))
    rows = [_floats(chain.rotation[j][k]) for k in range(3)]
    half = [tuple(_dot(rows[i], (turned[0][k], turned[1][k], turned[2][k])) for k in range(3)) for i in range(3)]
    inertia = [[_dot(half[i], rows[k]) for k in range(3)] for i in range(3)]
    m = _back(chain.rotation[j], turn, (body[1], body[2], body[3]))
    p = _reach(chain, j, q)
    # parallel axis for a first moment m and a mass: I + 2 (m.p) 1 - m p^T - p m^T + mass ((p.p) 1 - p p^T)
    n = tuple(_add(m[k], _mul(_mul(0.5, mass), p[k])) for k in range(3))
    trace = _mul(2.0, _dot(n, p))

    def entry(i: int, k: int) -> Scalar:
        mixed = _add(_mul(n[i], p[k]), _mul(p[i], n[k]))
        return _sub(_add(inertia[i][k], trace) if i == k else inertia[i][k], mixed)

    upper = [entry(i, k) for i, k in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    return mass, *(_add(m[k], _mul(mass, p[k])) for k in range(3)), *upper


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
            force, moment = (_sub(0.0, my), mx, 0.0), (ixz, iyz, izz)
            matrix[j][j] = izz
        else:
            force, moment = (0.0, 0.0, mass), (my, _sub(0.0, mx), 0.0)
            matrix[j][j] = mass
        for i in reversed(range(j)):
            moment = _back(chain.rotation[i + 1], turn[i + 1], moment)
            force = _back(chain.rotation[i + 1], turn[i + 1], force)
            moment = _plus(moment, _cross(_reach(chain, i + 1, q[i + 1]), force))
            matrix[i][j] = matrix[j][i] = moment[2] if chain.revolute[i] else force[2]
        if j:
            carried = _carried(chain, j, turn[j], q[j], composite[j])
            composite[j - 1] = tuple(_add(a, b) for a, b in zip(composite[j - 1], carried))
    return matrix
