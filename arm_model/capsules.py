"""Capsules round the primitive shapes of URDF, and capsules seen from another frame."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.description import Capsule


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
    capsule = Capsule(_vector(-half), _vector(half), radius)
    found = moved((capsule,), pose)
    assert found is not None
    return found[0]


def moved(capsules: tuple[Capsule, ...] | None, pose: Array) -> tuple[Capsule, ...] | None:
    """Capsules of a frame at ``pose`` (4, 4) in another, as capsules of that one."""
    if capsules is None:
        return None

    def there(point: tuple[float, float, float]) -> tuple[float, float, float]:
        return _vector(pose[:3, :3] @ np.array(point) + pose[:3, 3])

    return tuple(Capsule(there(one.start), there(one.end), one.radius) for one in capsules)


def _vector(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
