"""Where the links are. Poses are 4x4 homogeneous transforms in the base frame, m; q in rad (m for prismatic joints)."""

from __future__ import annotations

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm, Joint


def _exact(angle: float) -> tuple[float, float]:
    """cos and sin.

    Multiples of a quarter turn come out exactly, so that a right angle leaves no rounding errors in the equations.
    """
    quarter = 2 * angle / np.pi
    nearest = round(quarter)
    if abs(quarter - nearest) < 1e-12:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[nearest % 4]
    return float(np.cos(angle)), float(np.sin(angle))


def turn(axis: str, angle: float) -> Array:
    """(4, 4) rotation by ``angle`` rad about 'x', 'y' or 'z'."""
    cosine, sine = _exact(angle)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    pose = np.eye(4)
    pose[first, first] = pose[second, second] = cosine
    pose[first, second], pose[second, first] = -sine, sine
    return pose


def shift(x: float, y: float, z: float) -> Array:
    """(4, 4) translation in m."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def roll_pitch_yaw(rpy: tuple[float, float, float]) -> Array:
    """(4, 4) Rot(z, yaw) Rot(y, pitch) Rot(x, roll), as URDF has it."""
    return turn("z", rpy[2]) @ turn("y", rpy[1]) @ turn("x", rpy[0])


def rpy_of(pose: Array) -> tuple[float, float, float]:
    """(roll, pitch, yaw) rad of a pose (4, 4); where only their sum is determined (pitch a right angle), yaw is 0."""
    r = pose[:3, :3]
    level = float(np.hypot(r[0, 0], r[1, 0]))
    pitch = float(np.arctan2(-r[2, 0], level))
    if level < 1e-9:
        return float(np.arctan2(-r[1, 2], r[1, 1])), pitch, 0.0
    return float(np.arctan2(r[2, 1], r[2, 2])), pitch, float(np.arctan2(r[1, 0], r[0, 0]))


def rezeroed(joint: Joint, offset: float) -> dict[str, object]:
    """The joint's place with its zero moved by ``offset`` rad (m), as fields: J(q + offset) where it was J(q)."""
    if joint.convention != "placed":
        slot = "theta" if joint.revolute else "d"
        return {slot: getattr(joint, slot) + offset}
    onto = _z_onto(joint.axis)
    pose = shift(*joint.xyz) @ roll_pitch_yaw(joint.rpy) @ onto @ motion(joint, np.array(offset)) @ onto.T
    return {"xyz": tuple(map(float, pose[:3, 3])), "rpy": rpy_of(pose)}


def _z_onto(axis: tuple[float, float, float]) -> Array:
    """(4, 4) a rotation that takes z onto ``axis``."""
    z = np.array(axis, float) / np.linalg.norm(axis)
    near = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = near - z * (near @ z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return np.eye(4) if np.allclose(z, (0, 0, 1)) else pose


def placement(joint: Joint) -> tuple[Array, Array]:
    """(before, after), (4, 4) each: link frame in the previous one = before J(q) after, J about (along) z."""
    one = np.eye(4)
    if joint.convention == "placed":
        onto = _z_onto(joint.axis)
        return shift(*joint.xyz) @ roll_pitch_yaw(joint.rpy) @ onto, onto.T
    along_z = turn("z", joint.theta) @ shift(0, 0, joint.d)
    if joint.convention == "standard":
        return one, along_z @ shift(joint.a, 0, 0) @ turn("x", joint.alpha) @ turn("y", joint.beta)
    return turn("x", joint.alpha) @ shift(joint.a, 0, 0) @ turn("y", joint.beta) @ along_z, one


def motion(joint: Joint, q: Array) -> Array:
    """(..., 4, 4) J(q) of q (...)."""
    q = np.asarray(q, float)
    pose = np.zeros((*q.shape, 4, 4))
    pose[..., :, :] = np.eye(4)
    if joint.revolute:
        pose[..., 0, 0] = pose[..., 1, 1] = np.cos(q)
        pose[..., 1, 0] = np.sin(q)
        pose[..., 0, 1] = -pose[..., 1, 0]
    else:
        pose[..., 2, 3] = q
    return pose


def _check(arm: Arm, q: Array) -> Array:
    q = np.asarray(q, float)
    if q.shape[-1:] != (len(arm),):
        raise InputError("q", f"has shape {q.shape}; the last axis must be the {len(arm)} joints of the arm")
    return q


def link_frames(arm: Arm, q: Array) -> Array:
    """(..., n+1, 4, 4) poses of frames 0..n in the base frame, for q (..., n)."""
    q = _check(arm, q)
    frames = [np.broadcast_to(np.array(arm.base), (*q.shape[:-1], 4, 4))]
    for j, joint in enumerate(arm.joints):
        before, after = placement(joint)
        frames.append(frames[-1] @ before @ motion(joint, q[..., j]) @ after)
    return np.stack(frames, axis=-3)


def forward(arm: Arm, q: Array) -> Array:
    """(..., 4, 4) pose of the tool in the base frame, for q (..., n)."""
    return link_frames(arm, q)[..., -1, :, :] @ np.array(arm.tool)


def jacobian(arm: Arm, q: Array, point: Array | None = None) -> Array:
    """(..., 6, n) geometric Jacobian in the base frame.

    The first three rows are the linear velocity of the tool, the last three the angular velocity.

    ``point`` (3,) m: another point, in the frame of the last link, instead of the tool's origin.
    """
    q = _check(arm, q)
    frames = link_frames(arm, q)
    fixed = np.array(arm.tool)[:3, 3] if point is None else np.asarray(point, float)
    target = frames[..., -1, :3, 3] + frames[..., -1, :3, :3] @ fixed
    columns = np.zeros((*q.shape[:-1], 6, len(arm)))
    for j, joint in enumerate(arm.joints):
        axis = frames[..., j, :, :] @ placement(joint)[0]
        z = axis[..., :3, 2]
        if joint.revolute:
            columns[..., :3, j] = np.cross(z, target - axis[..., :3, 3])
            columns[..., 3:, j] = z
        else:
            columns[..., :3, j] = z
    return columns
