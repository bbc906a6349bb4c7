"""Rigid-body dynamics of a standard Denavit-Hartenberg arm in numba, written apart from ``arm_model``.

Recursive Newton-Euler in link frames (Craig, Introduction to Robotics, 3rd ed., section 6.5, for frames at the link's
end); the mass matrix by columns. Everything in SI units; inertias about the centre of mass, in the link frame.
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def turned(dh, q, turns):  # type: ignore[no-untyped-def]
    """Writes cos and sin of the joints at q (n,) into ``turns`` (n, 4); columns 2 and 3 hold the twists'."""
    for i in range(len(q)):
        turns[i, 0], turns[i, 1] = np.cos(q[i] + dh[i, 0]), np.sin(q[i] + dh[i, 0])


@numba.njit(cache=True, error_model="numpy")
def newton_euler(dh, turns, mass, com, inertia, gravity, qd, qdd, tau, work):  # type: ignore[no-untyped-def]
    """Joint torques ``tau`` (n,) of the links alone. dh (n, 4): theta offset, d, a, alpha; gravity (3,) points down.

    turns (n, 4): as ``turned`` leaves it; inertia (n, 6): xx yy zz xy yz xz; work (n, 6): scratch, so that nothing is
    allocated.
    """
    n = len(qd)
    wx = wy = wz = ax = ay = az = 0.0
    lx, ly, lz = -gravity[0], -gravity[1], -gravity[2]
    for i in range(n):
        ct, st, ca, sa = turns[i]
        px, py, pz = dh[i, 2], dh[i, 1] * sa, dh[i, 1] * ca  # from frame i-1 to i, in frame i
        # joint i turns about z of frame i-1
        bx, by, bz = ax + wy * qd[i], ay - wx * qd[i], az + qdd[i]
        vz = wz + qd[i]
        vx, vy = wx, wy
        wx = ct * vx + st * vy
        wy = -st * ca * vx + ct * ca * vy + sa * vz
        wz = st * sa * vx - ct * sa * vy + ca * vz
        ax = ct * bx + st * by
        ay = -st * ca * bx + ct * ca * by + sa * bz
        az = st * sa * bx - ct * sa * by + ca * bz
        kx = ct * lx + st * ly
        ky = -st * ca * lx + ct * ca * ly + sa * lz
        kz = st * sa * lx - ct * sa * ly + ca * lz
        # a point at r moves with k + a x r + w x (w x r) = k + a x r + w (w.r) - r (w.w)
        ww = wx * wx + wy * wy + wz * wz
        s = wx * px + wy * py + wz * pz
        lx = kx + ay * pz - az * py + wx * s - px * ww
        ly = ky + az * px - ax * pz + wy * s - py * ww
        lz = kz + ax * py - ay * px + wz * s - pz * ww
        cx, cy, cz = com[i, 0], com[i, 1], com[i, 2]
        s = wx * cx + wy * cy + wz * cz
        fx = mass[i] * (lx + ay * cz - az * cy + wx * s - cx * ww)
        fy = mass[i] * (ly + az * cx - ax * cz + wy * s - cy * ww)
        fz = mass[i] * (lz + ax * cy - ay * cx + wz * s - cz * ww)
        ixx, iyy, izz, ixy, iyz, ixz = inertia[i]
        hx = ixx * wx + ixy * wy + ixz * wz
        hy = ixy * wx + iyy * wy + iyz * wz
        hz = ixz * wx + iyz * wy + izz * wz
        dx, dy, dz = px + cx, py + cy, pz + cz
        t = work[i]
        t[0], t[1], t[2] = fx, fy, fz
        t[3] = ixx * ax + ixy * ay + ixz * az + wy * hz - wz * hy + dy * fz - dz * fy
        t[4] = ixy * ax + iyy * ay + iyz * az + wz * hx - wx * hz + dz * fx - dx * fz
        t[5] = ixz * ax + iyz * ay + izz * az + wx * hy - wy * hx + dx * fy - dy * fx
    fx = fy = fz = mx = my = mz = 0.0
    for i in range(n - 1, -1, -1):
        t = work[i]
        ct, st, ca, sa = turns[i]
        px, py, pz = dh[i, 2], dh[i, 1] * sa, dh[i, 1] * ca
        # the outer force acts at the far end of this link: its lever is the whole link
        ux = mx + t[3] + py * fz - pz * fy
        uy = my + t[4] + pz * fx - px * fz
        uz = mz + t[5] + px * fy - py * fx
        gx, gy, gz = fx + t[0], fy + t[1], fz + t[2]
        fx = ct * gx - st * ca * gy + st * sa * gz
        fy = st * gx + ct * ca * gy - ct * sa * gz
        fz = sa * gy + ca * gz
        mx = ct * ux - st * ca * uy + st * sa * uz
        my = st * ux + ct * ca * uy - ct * sa * uz
        mz = sa * uy + ca * uz
        tau[i] = mz


@numba.njit(cache=True, error_model="numpy")
def mass_matrix(dh, turns, mass, com, inertia, w):  # type: ignore[no-untyped-def]
    """Mass matrix (n, n) of the links alone into ``w.mass``, by columns (Walker & Orin, 1982, method 1).

    w: scratch, of which ``still`` (3,), ``rest`` and ``unit`` (n,) are zeros.
    """
    n = len(mass)
    for j in range(n):
        w.unit[j] = 1.0
        newton_euler(dh, turns, mass, com, inertia, w.still, w.rest, w.unit, w.column, w.links)
        w.unit[j] = 0.0
        for i in range(n):
            w.mass[i, j] = w.column[i]
