"""Capsules round the primitive shapes of URDF and round points, and capsules seen from another frame."""

from __future__ import annotations

from functools import partial

import numpy as np

from arm_io.types import Array
from arm_model.tables.link_shapes import Capsule


def of_geometry(shape: str, sizes: tuple[float, ...], pose: Array) -> Capsule:
    """A capsule round a shape of URDF at ``pose`` (4, 4).

    Boxes (x, y, z m): along the longest edge, as thick as half the diagonal across. Cylinders (radius, length) and
    capsules (radius, length without caps): along z. Spheres (radius).
    """
    half = np.zeros(3)
    if shape == "box":
        axis = int(np.argmax(sizes))
        half[axis] = sizes[axis] / 2
        radius = float(np.linalg.norm(np.delete(np.array(sizes), axis))) / 2
    else:
        radius = sizes[0]
        half[2] = 0.0 if shape == "sphere" else sizes[1] / 2
    capsule = Capsule(vector(-half), vector(half), radius)
    found = moved((capsule,), pose)
    assert found is not None
    return found[0]


def round_points(points: Array) -> Capsule:
    """The capsule of least volume found round points (k, 3): their convex hull, with the mesh between them, is inside.

    Its axis is searched from the principal directions of the hull; whatever the search finds encloses every point.
    """
    from scipy.optimize import minimize

    hull = _hull(points)
    centre = hull.mean(axis=0)
    size = max(float(np.abs(hull - centre).max()), 1e-9)
    _, _, axes = np.linalg.svd((hull - centre) / size)
    best: tuple[float, tuple[Array, Array]] | None = None
    for frame in (axes, np.roll(axes, 1, axis=0), np.roll(axes, 2, axis=0)):
        optimum = minimize(
            partial(_volume_along, hull, centre, size, frame),
            np.zeros(4),
            method="Nelder-Mead",
            options={"maxfev": 400, "xatol": 1e-4},
        )
        if best is None or optimum.fun < best[0]:
            best = float(optimum.fun), _line(centre, size, frame, optimum.x)
    assert best is not None
    start, end, radius = _along(points, *best[1])
    # rounding must not leave a point outside
    return Capsule(vector(start), vector(end), max(radius * (1.0 + 1e-9), 1e-9))


def _hull(points: Array) -> Array:
    """The points on the convex hull; all of them where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices], float)
    except (QhullError, ValueError):
        return points


def _line(centre: Array, size: float, frame: Array, x: Array) -> tuple[Array, Array]:
    """A point (3,) and a direction (3,): the first axis of a frame (3, 3), tilted and shifted along the others.

    x (4,): two tangents, and two shifts in units of ``size``.
    """
    direction = frame[0] + x[:2] @ frame[1:]
    return centre + size * (x[2:] @ frame[1:]), direction / np.linalg.norm(direction)


def _volume_along(points: Array, centre: Array, size: float, frame: Array, x: Array) -> float:
    """Volume over pi of the shortest capsule round points about a line (``_line``)."""
    start, end, radius = _along(points, *_line(centre, size, frame, x))
    return float(np.linalg.norm(end - start)) * radius**2 + 4 / 3 * radius**3


def _along(points: Array, on_axis: Array, axis: Array) -> tuple[Array, Array, float]:
    """Ends and radius of the shortest capsule round points about the line through ``on_axis`` along ``axis``."""
    along = (points - on_axis) @ axis
    off = np.linalg.norm(points - on_axis - along[:, None] * axis, axis=1)
    radius = float(off.max())
    cap = np.sqrt(np.maximum(radius**2 - off**2, 0.0))
    low, high = float((along + cap).min()), float((along - cap).max())
    if low > high:  # a sphere is enough
        low = high = (low + high) / 2
        radius = float(np.linalg.norm(points - on_axis - low * axis, axis=1).max())
    return on_axis + low * axis, on_axis + high * axis, radius


def moved(capsules: tuple[Capsule, ...] | None, pose: Array) -> tuple[Capsule, ...] | None:
    """Capsules of a frame at ``pose`` (4, 4) in another, as capsules of that one."""
    if capsules is None:
        return None

    def there(point: tuple[float, float, float]) -> tuple[float, float, float]:
        return vector(pose[:3, :3] @ np.array(point) + pose[:3, 3])

    return tuple(Capsule(there(capsule.start), there(capsule.end), capsule.radius) for capsule in capsules)


def vector(values: np.ndarray) -> tuple[float, float, float]:
    """The three entries of an array as floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z
