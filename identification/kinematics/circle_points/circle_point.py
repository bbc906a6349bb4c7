"""Circle-point analysis: the plane, centre and radius of the circle that the target draws while one joint turns.

Mooring, Roth and Driels, "Fundamentals of Manipulator Calibration", 1991, ch. 5; thesis 6.3. The plane comes from the
smallest singular vector of the points, the circle in it from Kasa's linear fit (IEEE Trans. IM 25, 1976) refined on
true distances, both without wrong points. The residual is resolved in three directions, over the joint's angle:

    across      along the axis: a second axis moving, a wobbling bearing
    radial      along the radius: an encoder cannot cause it
    tangential  along the path, from encoder angle against angle on the circle: encoder scale, eccentricity (once a
                turn), sag
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.models.chain import Mask

LEAST_ARC = np.radians(30.0)
"""rad: over this arc the sagitta is 3 % of the radius, and noise of the points counts thirtyfold in the centre."""
LEAST_POINTS = 10
"""Points of a circle, whose six parameters they must overdetermine."""


class DegenerateSweep(ValueError):
    """A sweep that determines no circle; the message is the reason and what would be right."""


@dataclass(frozen=True)
class Circle:
    """The circle of one joint's sweep, in the frame of the points.

    joint       from 1
    axis        (3,) unit vector along the joint axis, in the sense of positive joint angle
    centre      (3,) m; radius m
    arc         rad, swept
    q           (N,) rad, the joint's angle; at (joints,) rad, where the others were (the joint's own entry: where it
                began)
    zero        (3,) unit vector from the centre to where the target is at joint angle 0
    across, radial, tangential  (N,) m, residuals; inlier (N,) bool
    std_angle   rad and std_centre m: standard deviations of the axis's direction and of the centre
    """

    joint: int
    axis: Array
    centre: Array
    radius: float
    arc: float
    q: Array
    at: Array
    zero: Array
    across: Array
    radial: Array
    tangential: Array
    inlier: Mask
    std_angle: float
    std_centre: float

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of each residual over the good points, m."""
        good = self.inlier
        parts = {"across": self.across, "radial": self.radial, "tangential": self.tangential}
        return {name: float(np.sqrt(np.mean(part[good] ** 2))) for name, part in parts.items()}

    def once_a_turn(self) -> tuple[float, float, float]:
        """Amplitude rad, phase rad and share of the tangential residual that goes as amplitude sin(q + phase).

        Encoder eccentricity looks like this, and so does gravity sag of a joint about a horizontal axis.
        """
        q, angle = self.q[self.inlier], self.tangential[self.inlier] / self.radius
        columns = np.column_stack((np.sin(q), np.cos(q), np.ones_like(q), q - q.mean()))
        scale = np.linalg.norm(columns, axis=0)
        weights = np.linalg.lstsq(columns / scale, angle, rcond=1e-6)[0] / scale
        wave = columns[:, :2] @ weights[:2]
        total = float(np.sum((angle - angle.mean()) ** 2))
        residual_energy = float(np.sum((angle - columns @ weights) ** 2))
        share = 0.0 if total <= 0 else max(0.0, 1.0 - residual_energy / total)
        return (
            float(np.hypot(weights[0], weights[1])),
            float(np.arctan2(weights[1], weights[0])),
            share if wave.any() else 0.0,
        )


def fit_circle(q: Array, xyz: Array, joint: int) -> Circle:
    """The circle of ``joint`` (from 1) from recorded angles q (N, joints) rad and points xyz (N, 3) m.

    DegenerateSweep says why there is none: too few points, too short an arc, another joint moved, all points on a line.
    """
    q, xyz = np.asarray(q, float), np.asarray(xyz, float)
    good = np.isfinite(xyz).all(axis=1) & np.isfinite(q).all(axis=1)
    q, xyz = q[good], xyz[good]
    if len(q) < LEAST_POINTS:
        raise DegenerateSweep(f"joint {joint}: {len(q)} points; expected at least {LEAST_POINTS}")
    travel = np.ptp(q, axis=0)
    if travel.argmax() != joint - 1 and travel.max() > LEAST_ARC:
        raise DegenerateSweep(f"joint {joint}: joint {travel.argmax() + 1} moved instead")
    if travel[joint - 1] < LEAST_ARC:
        arc = np.degrees(travel[joint - 1])
        raise DegenerateSweep(f"joint {joint}: the sweep covers {arc:.3g} degrees; expected at least 30")
    others = np.delete(travel, joint - 1)
    if len(others) and others.max() > np.radians(1.0):
        which = int(np.argmax(np.where(np.arange(len(travel)) == joint - 1, 0.0, travel))) + 1
        raise DegenerateSweep(f"joint {joint}: joint {which} moved too, by {np.degrees(travel[which - 1]):.3g} degrees")
    weight = np.ones(len(q))
    for _ in range(12):
        centre, normal, radius = _plane_circle(xyz, weight, joint)
        across = (xyz - centre) @ normal
        radial = np.linalg.norm(xyz - centre - across[:, None] * normal, axis=1) - radius
        off = np.hypot(across, radial)
        scale = max(float(np.median(off)) / 1.1774, 1e-9)  # median length of a standard normal vector in the plane
        fresh = (off < 4.5 * scale).astype(float)
        if np.array_equal(fresh, weight):
            break
        weight = fresh
    return _with_encoder(q, xyz, joint, _Plane(centre, normal, radius, across, radial, weight > 0))


def _plane_circle(xyz: Array, weight: Array, joint: int) -> tuple[Array, Array, float]:
    """Centre (3,), unit normal (3,) and radius of the weighted points."""
    mean = np.average(xyz, axis=0, weights=weight)
    rows = (xyz - mean) * np.sqrt(weight)[:, None]
    _, spread, basis = np.linalg.svd(rows, full_matrices=False)
    if spread[1] < 1e-3 * spread[0]:
        raise DegenerateSweep(
            f"joint {joint}: all points lie on a line; the target is too near the joint axis, or it did not turn"
        )
    u, v = (xyz - mean) @ basis[0], (xyz - mean) @ basis[1]
    c, radius = _circle(u, v, weight)
    if radius > 50 * spread[0] / np.sqrt(weight.sum()):
        raise DegenerateSweep(f"joint {joint}: the points lie on a line, not on an arc")
    return mean + c[0] * basis[0] + c[1] * basis[1], basis[2], radius


def _circle(u: Array, v: Array, weight: Array) -> tuple[Array, float]:
    """Centre (2,) and radius: Kasa's linear fit, then Gauss-Newton on distances (which removes its bias)."""
    root = np.sqrt(weight)
    solution = np.linalg.lstsq(
        np.column_stack((u, v, np.ones_like(u))) * root[:, None], (u * u + v * v) * root, rcond=None
    )[0]
    x = np.array([solution[0] / 2, solution[1] / 2, 0.0])
    x[2] = np.sqrt(max(solution[2] + x[0] ** 2 + x[1] ** 2, 1e-18))
    for _ in range(20):
        du, dv = u - x[0], v - x[1]
        distance = np.maximum(np.hypot(du, dv), 1e-12)
        jacobian = np.column_stack((-du / distance, -dv / distance, -np.ones_like(u))) * root[:, None]
        step = np.linalg.lstsq(jacobian, -(distance - x[2]) * root, rcond=None)[0]
        x += step
        if np.linalg.norm(step) < 1e-12:
            break
    return x[:2], float(x[2])


@dataclass(frozen=True)
class _Plane:
    """A circle fitted to the points alone: the sense of its normal is not known yet; residuals (N,) m."""

    centre: Array
    normal: Array
    radius: float
    across: Array
    radial: Array
    inlier: Mask


def _with_encoder(q: Array, xyz: Array, joint: int, plane: _Plane) -> Circle:
    """Sense of rotation, zero direction and tangential residual from the joint's own encoder."""
    centre, normal, across, good = plane.centre, plane.normal, plane.across, plane.inlier
    encoder = q[:, joint - 1]
    flat = xyz - centre - across[:, None] * normal
    first = flat[0] / np.linalg.norm(flat[0])
    second = np.cross(normal, first)
    angle = np.arctan2(flat @ second, flat @ first)
    if _spread(angle[good] + encoder[good]) < _spread(angle[good] - encoder[good]):
        normal, second, angle, across = -normal, -second, -angle, -across
    middle = np.angle(np.mean(np.exp(1j * (angle - encoder)[good])))
    ahead = (angle - encoder - middle + np.pi) % (2 * np.pi) - np.pi  # angle on the circle less the encoder's
    slope = 1.0 + np.polyfit(encoder[good], ahead[good], 1)[0]
    if not 0.8 < slope < 1.25 or np.std(ahead[good]) > 0.3:
        raise DegenerateSweep(
            f"joint {joint}: the target turned {slope:.3g} times as far as the encoder says; is it this joint's "
            "channel?"
        )
    centred = float(np.median(ahead[good]))
    tangential = plane.radius * (ahead - centred)
    offset = middle + centred
    zero = np.cos(offset) * first + np.sin(offset) * second
    std_angle, std_centre = _uncertainty(flat[good], plane.radius, np.r_[across[good], plane.radial[good]])
    at = np.median(q, axis=0)
    at[joint - 1] = encoder[0]
    return Circle(
        joint=joint,
        axis=normal,
        centre=centre,
        radius=plane.radius,
        arc=float(np.ptp(encoder)),
        q=encoder,
        at=at,
        zero=zero,
        across=across,
        radial=plane.radial,
        tangential=tangential,
        inlier=good,
        std_angle=std_angle,
        std_centre=std_centre,
    )


def _spread(angle: Array) -> float:
    """Circular variance."""
    return 1.0 - float(np.abs(np.mean(np.exp(1j * angle))))


def _uncertainty(flat: Array, radius: float, off: Array) -> tuple[float, float]:
    """Standard deviations of axis direction (rad) and centre (m), in the worst direction.

    The noise of the points is taken as independent and equal.
    """
    noise = float(np.std(off))
    _, spread, basis = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    u, v = flat @ basis[0] / radius, flat @ basis[1] / radius
    jacobian = np.column_stack((u, v, np.ones_like(u)))
    centre = np.linalg.pinv(jacobian.T @ jacobian)
    return noise / max(float(spread[1]), 1e-12), noise * float(np.sqrt(np.linalg.eigvalsh(centre[:2, :2])[-1]))
