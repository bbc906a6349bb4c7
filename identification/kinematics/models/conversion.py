"""Product of exponentials -> D-H, Hayati, Whitney-Lozinski and S-model.

A frame is put on every joint axis (z along it) and the transform from one to the next is split into elementary factors.
Turning a frame about its own z and sliding it along is free: that freedom is carried on into the next link (D-H,
Hayati), kept in the link's own six numbers (S-model, Whitney-Lozinski), and at the end into the tool.

The common normal of two axes has two directions, and where axes intersect or are parallel it is not unique at all;
``near`` (a table of the same model, usually the nominal one) chooses. Without it: a >= 0, and d = 0 on parallel axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from arm_io.types import Array
from identification.kinematics.models.chain import product, xyz_ypr
from identification.kinematics.models.product_of_exponentials import Exponentials

PARALLEL = np.sin(np.radians(5.0))
"""Below this sine of the angle between neighbouring axes D-H is ill-conditioned (d runs away) and Hayati's beta is
used."""


@dataclass(frozen=True)
class Table:
    """The rows of a model of ``identification.kinematics.models.parameterisations``, with base and tool (4, 4)."""

    rows: Array
    base: Array
    tool: Array
    prismatic: tuple[bool, ...]


def to_hayati(model: Exponentials, near: Table | None = None) -> Table:
    """theta, d, a, alpha, beta (joints, 5): D-H, but Hayati's form for links whose next axis is (nearly) parallel."""
    return _dh(model, near, hayati_where_parallel=True)


def to_denavit_hartenberg(model: Exponentials, near: Table | None = None) -> Table:
    """theta, d, a, alpha (joints, 4). Exact always; on nearly parallel axes d is large and ill-conditioned."""
    table = _dh(model, near, hayati_where_parallel=False)
    return Table(table.rows[:, :4], table.base, table.tool, table.prismatic)


def _dh(model: Exponentials, near: Table | None, *, hayati_where_parallel: bool) -> Table:
    frames = axis_frames(model, near)
    n = len(frames)
    rows = np.zeros((n, 5))
    turned, slid = 0.0, 0.0  # how far the D-H frame is turned and slid on its axis, against the frame from axis_frames
    for j in range(n):
        here = frames[j] @ product(("rz", turned), ("tz", slid))
        if j == n - 1:  # nothing follows: the last link is what ``near`` says, and the tool takes the rest
            rows[j] = near.rows[j] if near is not None else np.zeros(5)
            tool = np.linalg.inv(_hayati(rows[j])) @ np.linalg.inv(here) @ model.home
            break
        step = np.linalg.inv(here) @ frames[j + 1]
        wanted = None if near is None else near.rows[j]
        parallel = np.hypot(step[0, 2], step[1, 2]) < PARALLEL
        if parallel and hayati_where_parallel:
            rows[j] = _hayati_row(step, wanted)
        else:
            rows[j] = [*_common_normal(step, wanted)[:4], 0.0]
        rest = np.linalg.inv(_hayati(rows[j])) @ step
        turned, slid = -np.arctan2(rest[1, 0], rest[0, 0]), -rest[2, 3]
    return Table(_near_turns(rows, near), frames[0], tool, model.prismatic)


def to_s_model(model: Exponentials, near: Table | None = None) -> Table:
    """beta, d, a, alpha, gamma, b (joints, 6): the common normal and how the next frame sits on its own axis."""
    frames = axis_frames(model, near)
    rows = np.zeros((len(frames), 6))
    for j, (here, there) in enumerate(pairwise(frames)):
        rows[j] = _common_normal(np.linalg.inv(here) @ there, None)
    return Table(rows, frames[0], np.linalg.inv(frames[-1]) @ model.home, model.prismatic)


def to_whitney_lozinski(model: Exponentials, near: Table | None = None) -> Table:
    """x, y, z, yaw, pitch, roll (joints, 6) from each axis's frame to the next."""
    frames = axis_frames(model, near)
    rows = np.zeros((len(frames), 6))
    for j, (here, there) in enumerate(pairwise(frames)):
        rows[j] = xyz_ypr(np.linalg.inv(here) @ there)
    return Table(rows, frames[0], np.linalg.inv(frames[-1]) @ model.home, model.prismatic)


def axis_frames(model: Exponentials, near: Table | None = None) -> list[Array]:
    """A frame (4, 4) on every axis at q = 0, z along it; the first as close as may be to the base of ``near``.

    The origin is the foot of the perpendicular from the frame before (from the base for the first), x the old x made
    perpendicular to the new z.
    """
    before = np.eye(4) if near is None else near.base
    frames: list[Array] = []
    for z, point in zip(*model.lines(), strict=True):
        origin, x = before[:3, 3], before[:3, 0]
        sliding = model.prismatic[len(frames)]
        foot = origin if sliding else point + z * (z @ (origin - point))
        across = x - z * (z @ x)
        if np.linalg.norm(across) < 0.1:  # the old x is along the new axis: take the old y
            across = before[:3, 1] - z * (z @ before[:3, 1])
        x = across / np.linalg.norm(across)
        frame = np.eye(4)
        frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = x, np.cross(z, x), z, foot
        frames.append(frame)
        before = frame
    return frames


def _common_normal(step: Array, wanted: Array | None) -> tuple[float, float, float, float, float, float]:
    """beta, d, a, alpha, gamma, b with step = Rz(beta) Tz(d) Tx(a) Rx(alpha) Rz(gamma) Tz(b)."""
    z, p = step[:3, 2], step[:3, 3]
    sine = float(np.hypot(z[0], z[1]))
    if sine > 1e-9:
        normal = np.array([-z[1], z[0], 0.0]) / sine  # z_before x z_next; the common normal up to its sign
        # Feet: p + s z lies on the normal through (0, 0, d): solve for s and d in the plane across the normal.
        s = -(p[:2] @ z[:2]) / (z[:2] @ z[:2])
        d, b = p[2] + s * z[2], -s
        a = float(p @ normal)
    else:  # parallel: any common normal; the one at height 0
        d = 0.0 if wanted is None else float(wanted[1])
        across = np.array([p[0], p[1], 0.0])
        a = float(np.linalg.norm(across))
        normal = across / a if a > 1e-12 else step[:3, 0] * np.sign(z[2])
        b = (p[2] - d) * np.sign(z[2])
    flip = (
        a < 0
        if wanted is None
        else _angle(np.arctan2(-normal[1], -normal[0]), wanted[0]) < _angle(np.arctan2(normal[1], normal[0]), wanted[0])
    )
    if flip:
        normal, a = -normal, -a
    beta = np.arctan2(normal[1], normal[0])
    y = np.array([-normal[1], normal[0], 0.0])
    alpha = np.arctan2(-(y @ z), z[2])
    rest = np.linalg.inv(product(("rz", beta), ("tz", d), ("tx", a), ("rx", alpha))) @ step
    return float(beta), float(d), a, float(alpha), float(np.arctan2(rest[1, 0], rest[0, 0])), float(b)


def _hayati_row(step: Array, wanted: Array | None) -> Array:
    """theta, d, a, alpha, beta such that the next axis passes through the new origin, at the required height d."""
    z, p = step[:3, 2], step[:3, 3]
    d = 0.0 if wanted is None else float(wanted[1])
    foot = p + z * (d - p[2]) / z[2]
    a = float(np.hypot(foot[0], foot[1]))
    theta = float(np.arctan2(foot[1], foot[0])) if a > 1e-12 else 0.0
    if wanted is not None and _angle(theta + np.pi, wanted[0]) < _angle(theta, wanted[0]):
        theta, a = theta + np.pi, -a
    local = product(("rz", -theta))[:3, :3] @ z  # = Rx(alpha) Ry(beta) e_z = (sin b, -sin a cos b, cos a cos b)
    return np.array([theta, d, a, np.arctan2(-local[1], local[2]), np.arcsin(np.clip(local[0], -1, 1))])


def _hayati(row: Sequence[float] | Array) -> Array:
    theta, d, a, alpha, beta = (float(v) for v in row)
    return product(("rz", theta), ("tz", d), ("tx", a), ("rx", alpha), ("ry", beta))


def _angle(one: ArrayLike, other: ArrayLike) -> float:
    """Distance of two angles on the circle, rad."""
    return float(np.abs((np.asarray(one) - np.asarray(other) + np.pi) % (2 * np.pi) - np.pi))


def _near_turns(rows: Array, near: Table | None) -> Array:
    """Angles theta, alpha brought to the turn nearest to the wanted ones (or to zero)."""
    rows = rows.copy()
    for column in (0, 3):
        wanted = 0.0 if near is None else near.rows[:, column]
        rows[:, column] = wanted + (rows[:, column] - wanted + np.pi) % (2 * np.pi) - np.pi
    return rows
