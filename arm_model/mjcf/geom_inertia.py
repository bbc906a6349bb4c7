"""Mass, centre and inertia of a MuJoCo geom of a primitive shape, as MuJoCo's compiler infers them."""

from __future__ import annotations

import math

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.mjcf.tree import Attributes, NeedsCompiler, Tree, towards
from arm_model.rigid_body.inertia import barycentric, transform

_SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
"""Shape -> how many sizes it has: radius, half length; half lengths, half axes."""
DENSITY = "1000"
"""kg/m3, MuJoCo's default."""


def geom_inertia(tree: Tree, body: str, geom: Attributes) -> Array:
    """(10,) barycentric parameters in the body's frame; InputError for a mesh that has a mass."""
    shape = geom.get("type", "mesh" if "mesh" in geom else "sphere")
    if shape == "plane" or _massless(geom):
        return np.zeros(10)
    if shape not in _SIZES or geom.get("shellinertia") == "true":
        raise NeedsCompiler(tree.path, f"body {body!r} has no <inertial>, and its <geom> is a {shape}")
    sizes, pose = _placed(tree, geom, shape)
    volume, per_mass = _solid(shape, sizes)
    mass = float(tree.numbers(geom, "mass", "0", 1)[0])
    if "mass" not in geom:
        mass = volume * float(tree.numbers(geom, "density", DENSITY, 1)[0])
    x, y, z = (mass * float(value) for value in per_mass)
    return transform(barycentric(mass, (0.0, 0.0, 0.0), (x, y, z, 0.0, 0.0, 0.0)), pose)


def _massless(geom: Attributes) -> bool:
    given = geom.get("mass", geom.get("density", "1"))
    try:
        return float(given) == 0.0
    except ValueError:
        return False


def _placed(tree: Tree, geom: Attributes, shape: str) -> tuple[Array, Array]:
    """Sizes (1 to 3,) m and pose (4, 4), by pos, orientation and size, or by the ends of its axis."""
    count = _SIZES[shape]
    if "fromto" not in geom:
        given = geom.get("size", "0").split()[:count]
        return tree.numbers({"size": " ".join(given)}, "size", "", count), tree.pose(geom)
    ends = tree.numbers(geom, "fromto", "", 6)
    along = ends[:3] - ends[3:]
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        raise InputError(tree.path, f"fromto={geom['fromto']!r}: begins where it ends")
    radius = float(tree.numbers({"size": geom.get("size", "0").split()[0]}, "size", "", 1)[0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = towards(along / length), (ends[:3] + ends[3:]) / 2
    return np.array([radius, *([radius] * (count - 2)), length / 2]), pose


def _solid(shape: str, size: Array) -> tuple[float, Array]:
    """Volume, m3, and principal inertias over the mass (3,), m2."""
    if shape == "sphere":
        r = size[0]
        return 4 / 3 * math.pi * r**3, np.full(3, 0.4 * r**2)
    if shape in ("box", "ellipsoid"):
        part = 3.0 if shape == "box" else 5.0
        squares = size**2
        volume = float(np.prod(size)) * (8.0 if shape == "box" else 4 / 3 * math.pi)
        return volume, (squares.sum() - squares) / part
    r, length = size[0], 2 * size[1]
    barrel = math.pi * r**2 * length
    across, axial = (3 * r**2 + length**2) / 12, r**2 / 2
    if shape == "cylinder":
        return barrel, np.array([across, across, axial])
    balls = 4 / 3 * math.pi * r**3
    of_ball = 0.4 * r**2
    of_cap = of_ball + length * (3 * r + 2 * length) / 8
    volume = barrel + balls
    x = (barrel * across + balls * of_cap) / volume
    return volume, np.array([x, x, (barrel * axial + balls * of_ball) / volume])
