"""Product of exponentials: T(q) = exp([S1] q1) ... exp([Sn] qn) M.

Sources: Brockett 1984; Lynch and Park, "Modern Robotics", ch. 4.

A screw S = (w, v) is the joint axis in the world at q = 0: w its direction and v = -w x p for a point p on it
(revolute), w = 0 and v the direction (prismatic). M is the end frame at q = 0. It has no singular cases and no choices
of frames, so other descriptions are converted through it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arm_io.types import Array
from identification.kinematics.models.chain import Chain, forward, joint_axes


@dataclass(frozen=True)
class Exponentials:
    """screws (joints, 6): direction w and moment v, unit speed; home (4, 4): the end frame at q = 0."""

    screws: Array
    home: Array

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """Which joints translate."""
        return tuple(bool(np.linalg.norm(s[:3]) < 0.5) for s in self.screws)

    def lines(self) -> tuple[Array, Array]:
        """Direction (joints, 3) of every axis, and its point (joints, 3) nearest to the world's origin.

        For prismatic joints that point is the origin itself.
        """
        w, v = self.screws[:, :3], self.screws[:, 3:]
        sliding = np.array(self.prismatic)[:, None]
        return np.where(sliding, v, w), np.where(sliding, 0.0, np.cross(w, v))


def exponential(screw: ArrayLike, angle: float | Array) -> Array:
    """exp([S] q) as (4, 4), or (N, 4, 4) for N angles: Rodrigues' formula for unit w, a translation for w = 0."""
    screw = np.asarray(screw, float)
    q = np.asarray(angle, float)
    w, v = screw[:3], screw[3:]
    out = np.zeros((*q.shape, 4, 4))
    out[..., :, :] = np.eye(4)
    if np.linalg.norm(w) < 0.5:
        out[..., :3, 3] = q[..., None] * v
        return out
    k = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    rotation = np.eye(3) + np.sin(q)[..., None, None] * k + (1 - np.cos(q))[..., None, None] * (k @ k)
    point = np.cross(w, v)  # nearest to the origin; no pitch
    out[..., :3, :3] = rotation
    out[..., :3, 3] = point - rotation @ point
    return out


def exponentials_of(chain: Chain) -> Exponentials:
    """The product of exponentials of any chain: its axes and its end frame at q = 0."""
    zero = np.zeros(chain.joints)
    direction, point = joint_axes(chain, zero)
    sliding = np.array([chain.steps[k].motion[0] == "t" for k in chain.joint_steps()])[:, None]
    w = np.where(sliding, 0.0, direction)
    v = np.where(sliding, direction, -np.cross(direction, point))
    return Exponentials(np.column_stack((w, v)), forward(chain, zero[None])[0])
