"""From circles to a kinematic model: the axis lines, brought into one configuration, give D-H (thesis 6.3).

Features are taken from the last joint inward, as they are measured. Putting them together goes outward, because an axis
that was seen while earlier joints were elsewhere must first be rotated back about those.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from identification.kinematics.circle_points.circle_point import Circle
from identification.kinematics.models.chain import Chain, forward, xyz_ypr
from identification.kinematics.models.hayati import Table, to_hayati
from identification.kinematics.models.parameters import base_pose
from identification.kinematics.models.product_of_exponentials import Exponentials, exponential, exponentials_of


def circle_point_model(circles: Sequence[Circle], nominal: Chain) -> Array:
    """Values (values,) of the chain from circle-point analysis alone; ``nominal`` in standard D-H, roughly in place.

    Joints that were not swept keep their nominal place relative to the one before. The zero of the last swept joint,
    and its place along its own axis, follow from the target, and are only as accurate as the known place of the target
    on the arm.
    """
    hub = axes_at_zero(circles, nominal)
    near = Table(_rows(nominal), base_pose(nominal), np.eye(4), hub.prismatic)
    table = to_hayati(hub, near)
    mount = forward(Chain(tuple(s for s in nominal.steps if s.name.startswith("mount."))), np.zeros((1, 0)))[0]
    correction = dict(
        zip(("x", "y", "z", "yaw", "pitch", "roll"), xyz_ypr(np.linalg.inv(mount) @ table.base), strict=True)
    )
    values = []
    for step in nominal.steps:
        group, _, name = step.name.partition(".")
        if group == "base":
            values.append(correction[name])
        elif group == "target":
            values.append(table.tool["xyz".index(name), 3])
        elif group == "mount":
            values.append(step.value)
        else:
            column = ("theta", "d", "a", "alpha", "beta").index(name)
            values.append(table.rows[int(group.removeprefix("joint")) - 1, column])
    return np.array(values, float)


def axes_at_zero(circles: Sequence[Circle], nominal: Chain) -> Exponentials:
    """All axes and the target at joint angles zero: measured where there is a circle, else nominal.

    A nominal axis keeps its place relative to the axis before it.
    """
    seen = {c.joint - 1: c for c in circles}
    hub = exponentials_of(nominal)
    directions, points = hub.lines()
    carried = np.eye(4)  # from the nominal to the measured place of all that lies beyond the joints done so far
    screws: list[Array] = []
    for j, (direction, point) in enumerate(zip(directions, points, strict=True)):
        w, p = _moved(carried, direction, point)
        if j in seen:
            back = np.linalg.inv(_turned(screws, seen[j].at))
            measured_w, measured_p = back[:3, :3] @ seen[j].axis, back[:3, :3] @ seen[j].centre + back[:3, 3]
            carried = _line_to_line(w, p, measured_w, measured_p) @ carried
            w, p = _moved(carried, direction, point)
        screws.append(np.concatenate((np.zeros(3), w) if hub.prismatic[j] else (w, -np.cross(w, p))))
    home = carried @ hub.home
    if seen:
        last = max(seen)
        back = np.linalg.inv(_turned(screws[:last], seen[last].at))
        carried = (
            _turn_to(seen[last], np.asarray(back), _with_outer(screws, last, seen[last].at, home), screws[last])
            @ carried
        )
        home = carried @ hub.home
        for j in range(last + 1, len(screws)):
            w, p = _moved(carried, directions[j], points[j])
            screws[j] = np.concatenate((np.zeros(3), w) if hub.prismatic[j] else (w, -np.cross(w, p)))
    return Exponentials(np.array(screws), home)


def _turned(screws: Sequence[Array], at: Array) -> Array:
    """(4, 4) exp(S1 q1) exp(S2 q2) ... of the joints that have screws (6,) so far, at angles ``at`` (n,) rad."""
    pose = np.eye(4)
    for screw, angle in zip(screws, at):
        pose = pose @ exponential(screw, float(angle))
    return pose


def _with_outer(screws: Sequence[Array], joint: int, at: Array, home: Array) -> Array:
    """Where the target is (3,) with joints up to ``joint`` at zero and the outer ones where they were."""
    pose = np.eye(4)
    for k in range(joint + 1, len(screws)):
        pose = pose @ exponential(screws[k], float(at[k]))
    return np.asarray((pose @ home)[:3, 3])


def _turn_to(circle: Circle, back: Array, predicted: Array, screw: Array) -> Array:
    """(4, 4) rotation about and translation along a swept axis that align the predicted target with the measurement.

    back (4, 4): from the world to where the axis is with all joints before it at zero; predicted (3,) m: the target
    there; screw (6,): direction and moment of the axis.

    Both are compared at joint angle zero: the direction to the target, and the plane of its circle.
    """
    w, point = screw[:3], np.cross(screw[:3], screw[3:])
    measured = back[:3, :3] @ circle.zero
    arm = predicted - point
    arm = arm - w * (w @ arm)
    pose = exponential(screw, float(np.arctan2(w @ np.cross(arm, measured), arm @ measured)))
    plane = back[:3, :3] @ circle.centre + back[:3, 3]
    pose[:3, 3] += w * (w @ (plane - predicted))
    return pose


def _moved(pose: Array, direction: Array, point: Array) -> tuple[Array, Array]:
    return pose[:3, :3] @ direction, pose[:3, :3] @ point + pose[:3, 3]


def _line_to_line(w: Array, p: Array, to_w: Array, to_p: Array) -> Array:
    """The smallest motion (4, 4) that carries one directed line into another.

    It is the shortest rotation between the directions, then a shift normal to the line.
    """
    normal = np.cross(w, to_w)
    sine = float(np.linalg.norm(normal))
    pose = np.eye(4)
    if sine > 1e-15:
        axis = normal / sine
        pose = exponential(np.concatenate((axis, -np.cross(axis, p))), float(np.arctan2(sine, w @ to_w)))
    shift = to_p - p
    pose[:3, 3] += shift - to_w * (to_w @ shift)
    return pose


def _rows(chain: Chain) -> Array:
    value = {s.name: s.value for s in chain.steps}
    names = ("theta", "d", "a", "alpha", "beta")
    return np.array([[value[f"joint{j}.{n}"] for n in names] for j in range(1, chain.joints + 1)])
