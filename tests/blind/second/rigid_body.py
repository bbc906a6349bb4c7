"""Torques of a serial arm by the recursive Newton-Euler equations, standard Denavit-Hartenberg frames, compiled.

Craig, "Introduction to Robotics", chapter 6, written in the frames at the far ends of the links; with the forces of
water on cylinders round the links (Morison, in strips).
"""

from __future__ import annotations

import numba
import numpy as np

from arm_io.types import Array

WATER = 1025.0
"""kg/m3."""
STRIPS = 12
"""Per cylinder, midpoint rule: 2e-3 of the drag of a link that turns about one end."""

Triple = tuple[float, float, float]


@numba.njit(cache=True)
def _cross(a: Triple, b: Triple) -> Triple:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@numba.njit(cache=True)
def _sum(a: Triple, b: Triple) -> Triple:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@numba.njit(cache=True)
def _times(s: float, a: Triple) -> Triple:
    return (s * a[0], s * a[1], s * a[2])


@numba.njit(cache=True)
def _row(a: Array, k: int) -> Triple:
    return (a[k, 0], a[k, 1], a[k, 2])


@numba.njit(cache=True)
def _inward(ct: float, st: float, ca: float, sa: float, v: Triple) -> Triple:
    """A vector of the frame before, in the frame of the link: R^T v."""
    x = ct * v[0] + st * v[1]
    y = -st * v[0] + ct * v[1]
    return (x, ca * y + sa * v[2], -sa * y + ca * v[2])


@numba.njit(cache=True)
def _outward(ct: float, st: float, ca: float, sa: float, v: Triple) -> Triple:
    """A vector of the link's frame, in the frame before: R v."""
    y = ca * v[1] - sa * v[2]
    return (ct * v[0] - st * y, st * v[0] + ct * y, sa * v[1] + ca * v[2])


@numba.njit(cache=True)
def _turned(inertia: Array, k: int, w: Triple) -> Triple:
    """I w, I given as xx, yy, zz, xy, yz, xz."""
    xx, yy, zz, xy, yz, xz = inertia[k]
    return (
        xx * w[0] + xy * w[1] + xz * w[2],
        xy * w[0] + yy * w[1] + yz * w[2],
        xz * w[0] + yz * w[1] + zz * w[2],
    )


@numba.njit(cache=True)
def _water(cylinder: Array, wet: bool, velocity: Triple, rate: Triple, pull: Triple, turn: Triple, down: Triple):  # type: ignore[no-untyped-def]
    """(force, moment about the link's origin) that water asks of the links, in the link's frame.

    cylinder (10,): start, end, radius, C_d, C_a, buoyancy; velocity and pull: of the link's origin, the latter its
    acceleration less gravity; rate, turn: angular velocity and acceleration; wet False: nothing that depends on speed.
    """
    start = (cylinder[0], cylinder[1], cylinder[2])
    along = (cylinder[3] - start[0], cylinder[4] - start[1], cylinder[5] - start[2])
    length = np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    axis = _times(1.0 / length, along)
    radius, dl = cylinder[6], length / STRIPS
    displaced = WATER * np.pi * radius**2 * dl
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(STRIPS):
        place = _sum(start, _times((k + 0.5) / STRIPS, along))
        a = _sum(_sum(pull, down), _sum(_cross(turn, place), _cross(rate, _cross(rate, place))))
        a = _sum(a, _times(-(a[0] * axis[0] + a[1] * axis[1] + a[2] * axis[2]), axis))
        f = _sum(_times(cylinder[8] * displaced, a), _times(cylinder[9] * displaced, down))
        if wet:
            v = _sum(velocity, _cross(rate, place))
            v = _sum(v, _times(-(v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]), axis))
            speed = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
            f = _sum(f, _times(WATER * cylinder[7] * radius * dl * speed, v))
        force, moment = _sum(force, f), _sum(moment, _cross(place, f))
    return force, moment


@numba.njit(cache=True)
def torques(
    dh: Array, bodies: Array, inertia: Array, cylinders: Array, gravity: Array, q: Array, qd: Array, qdd: Array
) -> Array:
    """(n,) N m at the joints.

    dh (n, 4): theta, d, a, alpha; bodies (n, 4): mass, centre in the link's frame; inertia (n, 6) about that centre:
    xx, yy, zz, xy, yz, xz; cylinders (n, 10), radius 0: none; gravity (3,) m/s2 in the base frame.
    """
    n = len(q)
    forces, moments, trig = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4))
    w, wd = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    v, a = (0.0, 0.0, 0.0), (-gravity[0], -gravity[1], -gravity[2])
    down = (gravity[0], gravity[1], gravity[2])
    wet = bool(np.any(qd != 0.0))
    for k in range(n):
        ct, st = np.cos(q[k] + dh[k, 0]), np.sin(q[k] + dh[k, 0])
        ca, sa = np.cos(dh[k, 3]), np.sin(dh[k, 3])
        trig[k, 0], trig[k, 1], trig[k, 2], trig[k, 3] = ct, st, ca, sa
        spin = (0.0, 0.0, qd[k])
        wd = _inward(ct, st, ca, sa, _sum(_sum(wd, (0.0, 0.0, qdd[k])), _cross(w, spin)))
        w = _inward(ct, st, ca, sa, _sum(w, spin))
        p = (dh[k, 2], dh[k, 1] * sa, dh[k, 1] * ca)
        v = _sum(_inward(ct, st, ca, sa, v), _cross(w, p))
        a = _sum(_inward(ct, st, ca, sa, a), _sum(_cross(wd, p), _cross(w, _cross(w, p))))
        down = _inward(ct, st, ca, sa, down)
        c = (bodies[k, 1], bodies[k, 2], bodies[k, 3])
        f = _times(bodies[k, 0], _sum(a, _sum(_cross(wd, c), _cross(w, _cross(w, c)))))
        m = _sum(_sum(_turned(inertia, k, wd), _cross(w, _turned(inertia, k, w))), _cross(c, f))
        if cylinders[k, 6] > 0.0:
            more, about = _water(cylinders[k], wet, v, w, a, wd, down)
            f, m = _sum(f, more), _sum(m, about)
        for x in range(3):
            forces[k, x], moments[k, x] = f[x], m[x]
    tau = np.empty(n)
    f, m = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(n - 1, -1, -1):
        ct, st, ca, sa = trig[k, 0], trig[k, 1], trig[k, 2], trig[k, 3]
        f = _sum(f, _row(forces, k))
        m = _sum(m, _row(moments, k))
        # about the origin of the frame before, where the joint's axis is
        m = _sum(m, _cross((dh[k, 2], dh[k, 1] * sa, dh[k, 1] * ca), f))
        f, m = _outward(ct, st, ca, sa, f), _outward(ct, st, ca, sa, m)
        tau[k] = m[2]
    return tau


@numba.njit(cache=True)
def mass_matrix(dh: Array, bodies: Array, inertia: Array, cylinders: Array, q: Array, out: Array) -> None:
    """(n, n) into ``out``: torques of unit accelerations at rest, without gravity."""
    n = len(q)
    still, gravity = np.zeros(n), np.zeros(3)
    for k in range(n):
        unit = np.zeros(n)
        unit[k] = 1.0
        # buoyancy is no inertia, and vanishes with gravity
        out[:, k] = torques(dh, bodies, inertia, cylinders, gravity, q, still, unit)


@numba.njit(cache=True)
def target(dh: Array, q: Array, place: Array) -> Array:
    """(m, 3) m: a point of the last link in the base frame at angles q (m, n)."""
    points = np.empty((len(q), 3))
    for row in range(len(q)):
        x = (place[0], place[1], place[2])
        for k in range(len(dh) - 1, -1, -1):
            ct, st = np.cos(q[row, k] + dh[k, 0]), np.sin(q[row, k] + dh[k, 0])
            ca, sa = np.cos(dh[k, 3]), np.sin(dh[k, 3])
            turned = _outward(ct, st, ca, sa, x)
            x = _sum(turned, (dh[k, 2] * ct, dh[k, 2] * st, dh[k, 1]))
        points[row, 0], points[row, 1], points[row, 2] = x[0], x[1], x[2]
    return points
