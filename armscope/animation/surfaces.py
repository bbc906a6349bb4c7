"""The surfaces of an arm in an animation: STL meshes of its URDF file, thinned, or the capsules of its model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_io.types import Array

if TYPE_CHECKING:
    from arm_model import Arm

MOST = 1500
"""Triangles of an arm: of more, a frame takes longer to draw than all the rest of it."""
LIGHT = np.array([-0.4, -0.7, 0.6]) / np.linalg.norm([-0.4, -0.7, 0.6])
SIDES = 12
"""Of a capsule."""
FAINTEST = 0.45
"""Brightness of a triangle that is seen edge on by the light."""


@dataclass(frozen=True)
class Surface:
    """``triangles`` (k, 3, 3) m in the frame of ``link``, 0: the base."""

    link: int
    triangles: Array

    def corners(self, frames: Array) -> Array:
        """(k, 8, 3) m: of the box round the triangles, for links at poses (k, n + 1, 4, 4)."""
        low, high = self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))
        box = np.stack(np.meshgrid(*zip(low, high), indexing="ij"), axis=-1).reshape(8, 3)
        poses = frames[:, self.link]
        return np.asarray(box @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3], float)


def read_surfaces(model: Path | None) -> tuple[Surface, ...]:
    """Of the STL meshes that a URDF file names and that are there; of another model none.

    InputError where one cannot be read.
    """
    from arm_model.visuals import read_visuals, triangles_of

    if model is None:
        return ()
    found = [(one.link, triangles_of(one)) for one in read_visuals(model) if one.file.suffix.lower() == ".stl"]
    total = sum(len(triangles) for _, triangles in found)
    return tuple(Surface(link, thinned(each, MOST * len(each) // max(total, 1) + 12)) for link, each in found)


def capsule_surfaces(arm: Arm) -> tuple[Surface, ...]:
    """Of the capsules that a model states (``[[capsule]]``, collision shapes of URDF); none where it states none."""
    stated = [(0, arm.capsule or ()), *((link, joint.capsule or ()) for link, joint in enumerate(arm.joints, 1))]
    return tuple(
        Surface(link, capsule_triangles(np.array(one.start), np.array(one.end), one.radius))
        for link, capsules in stated
        for one in capsules
    )


def capsule_triangles(start: Array, end: Array, radius: float) -> Array:
    """(k, 3, 3) m round the segment from start to end (3,) m: twelve sides, with corners on the surface."""
    along = end - start
    length = float(np.linalg.norm(along))
    z = along / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    turn = np.linspace(0.0, 2 * np.pi, SIDES + 1)
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(z, x)
    rings = [
        centre + radius * (np.cos(rise) * around + np.sin(rise) * z)
        for centre, rises in ((start, (-90, -45, 0)), (end, (0, 45, 90)))
        for rise in np.radians(rises)
    ]
    grid = np.array(rings)
    corners = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
    halves = [np.stack([corners[a], corners[b], corners[c]], axis=-2) for a, b, c in ((0, 1, 2), (0, 2, 3))]
    return np.concatenate([half.reshape(-1, 3, 3) for half in halves])


def thinned(triangles: Array, most: int) -> Array:
    """(k, 3, 3) with at most ``most`` triangles: all corners within a cell of a grid become their mean.

    The grid is the finest one that gives so few triangles.
    """
    if len(triangles) <= most:
        return triangles
    low, size = triangles.min(axis=(0, 1)), float(np.ptp(triangles, axis=(0, 1)).max())
    for cells in (64, 48, 36, 27, 20, 15, 11, 8, 6, 4, 3, 2):
        codes = np.floor((triangles - low) * (cells / size)).astype(np.int64) @ np.array([10**6, 10**3, 1])
        named, places = np.unique(codes, return_inverse=True)
        corners = np.sort(places.reshape(-1, 3), axis=1)
        kept = np.unique(corners[np.all(np.diff(corners, axis=1) > 0, axis=1)], axis=0)
        if len(kept) <= most:
            break
    means = np.zeros((len(named), 3))
    np.add.at(means, places.ravel(), triangles.reshape(-1, 3))
    means /= np.bincount(places.ravel())[:, None]
    return np.asarray(means[kept[:most]], float)


class Drawn:
    """The surfaces in one panel, moved from frame to frame."""

    def __init__(self, axis: Any, surfaces: tuple[Surface, ...], colour: str) -> None:
        from matplotlib.colors import to_rgb
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        self._surfaces, self._colour = surfaces, np.array(to_rgb(colour))
        self._shown = Poly3DCollection(np.zeros((1, 3, 3)), linewidths=0.0)
        axis.add_collection3d(self._shown)

    def show(self, frames: Array) -> None:
        """Draws the links at their poses (n + 1, 4, 4)."""
        placed = [one.triangles @ frames[one.link, :3, :3].T + frames[one.link, :3, 3] for one in self._surfaces]
        triangles = np.concatenate(placed)
        if np.isnan(triangles).any():
            self._shown.set_verts([])
            return
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        size = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
        light = FAINTEST + (1 - FAINTEST) * np.abs(normal @ LIGHT) / size
        self._shown.set_verts(triangles)
        self._shown.set_facecolor(np.clip(light[:, None] * self._colour + 0.25 * light[:, None], 0.0, 1.0))
