"""A kinematic chain as a sequence of elementary transforms, with positions and their exact Jacobian.

Every kinematic model used here (D-H, Hayati, Whitney-Lozinski, S-model) is a product of rotations about and
translations along the coordinate axes of the moving frame; they differ only in the order and number of the factors
(Corke and Haviland, "Not your grandmother's toolbox", ICRA 2021, call this an elementary transform sequence). Written
so, one loop gives the forward kinematics and one rule the Jacobian of all models:

    d p / d value = axis                       for a translation,
    d p / d value = axis x (p - origin)        for a rotation,

with the axis and origin of the frame in which the factor acts, seen from the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arm_io.types import Array

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Motion = Literal["tx", "ty", "tz", "rx", "ry", "rz"]


@dataclass(frozen=True, slots=True)
class Step:
    """One elementary transform of ``value`` (rad, m), plus the joint coordinate where ``joint`` (0-based) is given.

    ``name`` is the parameter's name, like ``joint2.alpha``. ``target`` (0-based): the step belongs to that target
    alone; None: to all.
    """

    motion: Motion
    value: float
    name: str
    joint: int | None = None
    target: int | None = None


@dataclass(frozen=True)
class Chain:
    """World frame -> base -> joints -> end point: the product of ``steps`` from left to right."""

    steps: tuple[Step, ...]

    @property
    def joints(self) -> int:
        """Number of joint coordinates."""
        return 1 + max((s.joint for s in self.steps if s.joint is not None), default=-1)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values, in the order of the steps."""
        return tuple(s.name for s in self.steps)

    @property
    def values(self) -> Array:
        """(steps,) rad and m."""
        return np.array([s.value for s in self.steps], float)

    def at(self, values: ArrayLike) -> Chain:
        """The same chain with other values (steps,)."""
        numbers = np.asarray(values, float)
        pairs = zip(self.steps, numbers, strict=True)
        return Chain(tuple(Step(s.motion, float(v), s.name, s.joint, s.target) for s, v in pairs))

    def joint_steps(self) -> list[int]:
        """Index of the step that carries each joint coordinate."""
        where = {s.joint: k for k, s in enumerate(self.steps) if s.joint is not None}
        return [where[j] for j in range(self.joints)]


def forward(chain: Chain, q: ArrayLike, target: Index | None = None) -> Array:
    """Poses (N, 4, 4) of the end frame in the world for joint coordinates q (N, joints) rad or m.

    target (N,): number of the target that each row is about; None: the first one everywhere.
    """
    q = _rows(chain, q)
    axes, origin = _start()
    for step in chain.steps:
        axes, origin = _advance(axes, origin, step, q, target)
    pose = np.zeros((len(q), 4, 4))
    for column in range(3):
        pose[:, :3, column] = axes[column]
    pose[:, :3, 3] = origin
    pose[:, 3, 3] = 1.0
    return pose


def position(chain: Chain, q: ArrayLike, target: Index | None = None) -> Array:
    """Positions (N, 3) m of the target in the world for q (N, joints); target (N,) as in ``forward``."""
    q = _rows(chain, q)
    axes, origin = _start()
    for step in chain.steps:
        axes, origin = _advance(axes, origin, step, q, target)
    return np.broadcast_to(origin, (len(q), 3)).copy()


def position_jacobian(chain: Chain, q: ArrayLike, target: Index | None = None) -> tuple[Array, Array]:
    """Positions (N, 3) and their derivatives (N, 3, steps) with respect to every value of the chain.

    The column of a joint's step is also the derivative with respect to that joint coordinate. target (N,) as in
    ``forward``: a row does not depend on the values of other targets.
    """
    q = _rows(chain, q)
    axes, origin = _start()
    acting = []
    for step in chain.steps:
        acting.append((axes["xyz".index(step.motion[1])], origin))
        axes, origin = _advance(axes, origin, step, q, target)
    end = np.broadcast_to(origin, (len(q), 3))
    derivative = np.empty((len(q), 3, len(chain.steps)))
    for k, (step, (axis, at)) in enumerate(zip(chain.steps, acting, strict=True)):
        derivative[:, :, k] = axis if step.motion[0] == "t" else _cross(axis, end - at)
        if step.target is not None:
            derivative[:, :, k] *= _share(step, target)
    return end.copy(), derivative


def pose_jacobian(chain: Chain, q: ArrayLike, target: Index | None) -> tuple[Array, Array]:
    """Rotations (N, 3, 3) of the end frame, and their derivatives (N, 3, steps) as rotation vectors in the world.

    A small change dx of the values turns the end frame by derivative dx (rad): R becomes exp([derivative dx]) R.
    """
    q = _rows(chain, q)
    axes, origin = _start()
    derivative = np.zeros((len(q), 3, len(chain.steps)))
    for k, step in enumerate(chain.steps):
        if step.motion[0] == "r":
            derivative[:, :, k] = axes["xyz".index(step.motion[1])] * _share(step, target)
        axes, origin = _advance(axes, origin, step, q, target)
    rotation = np.empty((len(q), 3, 3))
    for column in range(3):
        rotation[:, :, column] = axes[column]
    return rotation, derivative


def joint_axes(chain: Chain, q: ArrayLike) -> tuple[Array, Array]:
    """Directions and points (joints, 3) of the joint axes in the world, in the one configuration q (joints,)."""
    q = _rows(chain, np.atleast_2d(np.asarray(q, float)))
    axes, origin = _start()
    direction, point = np.empty((chain.joints, 3)), np.empty((chain.joints, 3))
    for step in chain.steps:
        if step.joint is not None:
            direction[step.joint], point[step.joint] = axes["xyz".index(step.motion[1])], origin
        axes, origin = _advance(axes, origin, step, q)
    return direction, point


Axes = tuple[Array, Array, Array]
_ALONG: tuple[Motion, ...] = ("tx", "ty", "tz")


def _start() -> tuple[Axes, Array]:
    x, y, z = np.eye(3)[:, None, :]  # (1, 3) each: broadcast until the first joint makes them (N, 3)
    return (x, y, z), np.zeros((1, 3))


def _share(step: Step, target: Index | None) -> float | Array:
    """1 for rows (N, 1) that a step acts on, 0 for those of other targets."""
    if step.target is None:
        return 1.0
    return float(step.target == 0) if target is None else (target == step.target)[:, None].astype(float)


def _advance(axes: Axes, origin: Array, step: Step, q: Array, target: Index | None = None) -> tuple[Axes, Array]:
    """The frame after one step, seen from the world: columns of its rotation and its origin."""
    value: float | Array = step.value
    if step.joint is not None:
        value = step.value + q[:, step.joint, None]
    elif value == 0.0:
        return axes, origin
    if step.target is not None:
        value = value * _share(step, target)
    along = "xyz".index(step.motion[1])
    if step.motion[0] == "t":
        return axes, origin + value * axes[along]
    c, s = np.cos(value), np.sin(value)
    moved = list(axes)
    first, second = (along + 1) % 3, (along + 2) % 3
    moved[first] = c * axes[first] + s * axes[second]
    moved[second] = c * axes[second] - s * axes[first]
    return (moved[0], moved[1], moved[2]), origin


def _cross(a: Array, b: Array) -> Array:
    """Vector product along the last axis; numpy's own costs several times as much on small rows."""
    ax, ay, az = a[:, 0], a[:, 1], a[:, 2]
    bx, by, bz = b[:, 0], b[:, 1], b[:, 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


def _rows(chain: Chain, q: ArrayLike) -> Array:
    q = np.atleast_2d(np.asarray(q, float))
    if q.ndim != 2 or q.shape[1] < chain.joints:
        raise ValueError(f"q needs shape (N, {chain.joints}), has {q.shape}")
    return q


def placement(prefix: str, pose: ArrayLike) -> list[Step]:
    """A fixed transform (4, 4) as six steps PREFIX.x .y .z .yaw .pitch .roll: Trans(x, y, z) Rot(z) Rot(y) Rot(x)."""
    x, y, z, yaw, pitch, roll = xyz_ypr(pose)
    return [
        Step("tx", x, f"{prefix}.x"),
        Step("ty", y, f"{prefix}.y"),
        Step("tz", z, f"{prefix}.z"),
        Step("rz", yaw, f"{prefix}.yaw"),
        Step("ry", pitch, f"{prefix}.pitch"),
        Step("rx", roll, f"{prefix}.roll"),
    ]


def target_steps(prefix: str, point: Sequence[float] | Array, number: int | None = None) -> list[Step]:
    """A point fixed in the last frame, as three translations PREFIX.x .y .z, m; ``number``: of several targets."""
    return [Step(motion, float(v), f"{prefix}.{motion[1]}", None, number) for motion, v in zip(_ALONG, point)]


def turn_steps(prefix: str, number: int) -> list[Step]:
    """The orientation of a target's frame in the last frame, as PREFIX.yaw .pitch .roll, rad: Rot(z) Rot(y) Rot(x)."""
    turns: tuple[tuple[Motion, str], ...] = (("rz", "yaw"), ("ry", "pitch"), ("rx", "roll"))
    return [Step(motion, 0.0, f"{prefix}.{name}", None, number) for motion, name in turns]


def xyz_ypr(pose: ArrayLike) -> tuple[float, float, float, float, float, float]:
    """x, y, z m and yaw, pitch, roll rad of a pose (4, 4) = Trans(x, y, z) Rot(z, yaw) Rot(y, pitch) Rot(x, roll)."""
    pose = np.asarray(pose, float)
    r = pose[:3, :3]
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    if np.hypot(r[0, 0], r[1, 0]) > 1e-9:
        yaw, roll = np.arctan2(r[1, 0], r[0, 0]), np.arctan2(r[2, 1], r[2, 2])
    else:  # pitch +-90 degrees: only yaw -+ roll is defined; put all into yaw
        yaw, roll = np.arctan2(-r[0, 1], r[1, 1]), 0.0
    x, y, z = pose[:3, 3]
    return float(x), float(y), float(z), float(yaw), float(pitch), float(roll)


def product(*steps: tuple[Motion, float]) -> Array:
    """The homogeneous transform (4, 4) of several steps, from left to right."""
    return forward(Chain(tuple(Step(m, v, "") for m, v in steps)), np.zeros((1, 0)))[0]
