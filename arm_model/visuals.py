"""The meshes of a URDF file: which files show which link of the arm, and where.

Links are numbered as ``arm_model.urdf.read_urdf`` numbers them, which makes the frame of each link that of its URDF
link; what is fixed to a link belongs to it.
"""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_io import read_file
from arm_io.types import Array
from arm_model import meshes
from arm_model.meshes import mesh_file
from arm_model.urdf.reading import numbers_of, origin_of
from arm_model.urdf.tree import Tree, link_at, robot_of


@dataclass(frozen=True, kw_only=True)
class Visual:
    """A mesh of link ``link`` (0: the base): ``file``, times ``scale`` (3,), at ``pose`` (4, 4) in the link's frame."""

    link: int
    file: Path
    scale: tuple[float, ...]
    pose: Array


def read_visuals(path: str | Path) -> tuple[Visual, ...]:
    """The meshes of a model file: of a URDF file with one serial chain those whose files are there; of others none.

    InputError as ``read_urdf``.
    """
    path = Path(path)
    if path.suffix != ".urdf":
        return ()
    robot = robot_of(path, read_file(path))
    tree = Tree.of(path, robot)
    chain = tree.chain(None)
    visuals: list[Visual] = []
    number, pose = 0, np.eye(4)
    for joint, link in zip([None, *chain], tree.names(chain)):
        if joint is not None and joint.get("type") == "fixed":
            pose = pose @ origin_of(path, joint)
        elif joint is not None:
            number, pose = number + 1, np.eye(4)
        visuals += _with_fixed(path, tree, link, chain, number, pose)
    return tuple(visuals)


def _with_fixed(
    path: Path, tree: Tree, link: str, chain: Sequence[xml.Element], number: int, pose: Array
) -> list[Visual]:
    """The meshes of a link, and of what hangs on it beside the chain."""
    found = _of_link(path, tree.links[link], number, pose)
    for joint in tree.beside(link, chain):
        child = link_at(path, joint, "child")
        found += _with_fixed(path, tree, child, chain, number, pose @ origin_of(path, joint))
    return found


def _of_link(path: Path, link: xml.Element, number: int, pose: Array) -> list[Visual]:
    visuals = []
    for visual in link.findall("visual"):
        mesh = visual.find("geometry/mesh")
        file = None if mesh is None else mesh_file(path, mesh.get("filename", ""))
        if mesh is not None and file is not None:
            scale = numbers_of(path, mesh, "scale", "1 1 1", 3)
            visuals.append(Visual(link=number, file=file, scale=scale, pose=pose @ origin_of(path, visual)))
    return visuals


def triangles_of(visual: Visual) -> Array:
    """(k, 3, 3) m: the triangles of an STL mesh in the frame of its link. InputError where it cannot be read."""
    corners = meshes.triangles_of(visual.file) * np.array(visual.scale)
    return np.asarray(corners @ visual.pose[:3, :3].T + visual.pose[:3, 3], float)
