"""Product of exponentials -> Denavit-Hartenberg parameters, with Hayati's angle where axes are parallel.

A link is Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta). beta is 0, and theta, d, a, alpha are those of Denavit and
Hartenberg (J. Appl. Mech. 22, 1955), unless the next axis is nearly parallel: then beta is estimated and d kept (Hayati
and Mirmirani, J. Robotic Systems 2(4), 1985).

A frame is put on every joint axis (z along it) and the transform from one to the next is split into these factors.
Turning a frame about its own z and sliding it along is free: that freedom is carried on into the next link, and at the
end into the tool.

The common normal of two axes has two directions, and where axes intersect or are parallel it is not unique at all;
``near`` (usually the nominal table) chooses. Without it: a >= 0, and d = 0 on parallel axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arm_io.types import Array
from identification.kinematics.models.chain import product
from identification.kinematics.models.product_of_exponentials import Exponentials

PARALLEL = np.sin(np.radians(5.0))
"""Below this sine of the angle between neighbouring axes D-H is ill-conditioned (d runs away) and Hayati's beta is
used."""


@dataclass(frozen=True)
class Table:
    """rows (joints, 5): theta, d, a, alpha, beta, rad and m; base and tool (4, 4)."""

    rows: Array
    base: Array
    tool: Array
    prismatic: tuple[bool, ...]


def to_hayati(model: Exponentials, near: Table | None = None) -> Table:
    """The table of an arm whose axes and end frame at q = 0 are known."""
    frames = axis_frames(model, near)
    n = len(frames)
    rows = np.zeros((n, 5))
    turned, slid = 0.0, 0.0  # how far the D-H frame is turned and slid on its axis, against the frame from axis_frames
    for j in range(n):
        here = frames[j] @ product(("rz", turned), ("tz", slid))
        if j == n - 1:  # nothing follows: the last link is what ``near`` says, and the tool takes the rest
            rows[j] = near.rows[j] if near is not None else np.zeros(5)
            tool = np.linalg.inv(_link(rows[j])) @ np.linalg.inv(here) @ model.home
            break
        step = np.linalg.inv(here) @ frames[j + 1]
        chosen = None if near is None else near.rows[j]
        parallel = np.hypot(step[0, 2], step[1, 2]) < PARALLEL
        rows[j] = _hayati_row(step, chosen) if parallel else _common_normal(step, chosen)
        rest = np.linalg.inv(_link(rows[j])) @ step
        turned, slid = -np.arctan2(rest[1, 0], rest[0, 0]), -rest[2, 3]
    return Table(_near_turns(rows, near), frames[0], tool, model.prismatic)


def axis_frames(model: Exponentials, near: Table | None) -> list[Array]:
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


def _common_normal(step: Array, chosen: Array | None) -> Array:
    """theta, d, a, alpha, 0 along the common normal of two axes; ``step`` (4, 4): from one frame to the next."""
    z, p = step[:3, 2], step[:3, 3]
    normal = np.array([-z[1], z[0], 0.0]) / np.hypot(z[0], z[1])  # z_before x z_next; up to its sign
    # the foot p + s z of the normal lies on it through (0, 0, d): solved for s in the plane across
    d = p[2] - z[2] * (p[:2] @ z[:2]) / (z[:2] @ z[:2])
    a = float(p @ normal)
    flip = a < 0 if chosen is None else _distance(_heading(-normal), chosen[0]) < _distance(_heading(normal), chosen[0])
    if flip:
        normal, a = -normal, -a
    y = np.array([-normal[1], normal[0], 0.0])
    return np.array([_heading(normal), d, a, np.arctan2(-(y @ z), z[2]), 0.0])


def _heading(direction: Array) -> float:
    """rad about z."""
    return float(np.arctan2(direction[1], direction[0]))


def _hayati_row(step: Array, chosen: Array | None) -> Array:
    """(5,) theta, d, a, alpha, beta (rad, m) such that the next axis passes through the new origin, at height d.

    step (4, 4): pose of the next axis in the frame of this one; chosen (5,): the row of the nominal model, whose d is
    kept and whose theta decides between the two solutions; None: d of 0.
    """
    z, p = step[:3, 2], step[:3, 3]
    d = 0.0 if chosen is None else float(chosen[1])
    foot = p + z * (d - p[2]) / z[2]
    a = float(np.hypot(foot[0], foot[1]))
    theta = float(np.arctan2(foot[1], foot[0])) if a > 1e-12 else 0.0
    if chosen is not None and _distance(theta + np.pi, chosen[0]) < _distance(theta, chosen[0]):
        theta, a = theta + np.pi, -a
    local = product(("rz", -theta))[:3, :3] @ z  # = Rx(alpha) Ry(beta) e_z = (sin b, -sin a cos b, cos a cos b)
    return np.array([theta, d, a, np.arctan2(-local[1], local[2]), np.arcsin(np.clip(local[0], -1, 1))])


def _link(row: Sequence[float] | Array) -> Array:
    theta, d, a, alpha, beta = (float(v) for v in row)
    return product(("rz", theta), ("tz", d), ("tx", a), ("rx", alpha), ("ry", beta))


def _distance(one: ArrayLike, other: ArrayLike) -> float:
    """Distance of two angles on the circle, rad."""
    return float(np.abs((np.asarray(one) - np.asarray(other) + np.pi) % (2 * np.pi) - np.pi))


def _near_turns(rows: Array, near: Table | None) -> Array:
    """Angles theta, alpha brought to the turn nearest to those of ``near`` (or to zero)."""
    rows = rows.copy()
    for column in (0, 3):
        nearest = 0.0 if near is None else near.rows[:, column]
        rows[:, column] = nearest + (rows[:, column] - nearest + np.pi) % (2 * np.pi) - np.pi
    return rows
