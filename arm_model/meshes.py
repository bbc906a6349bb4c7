"""Vertices of mesh files: STL (binary and text), OBJ and Collada. What a bounding shape needs of them, and no more."""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from pathlib import Path

import numpy as np

from arm_io import InputError, read_file
from arm_io.types import Array

FORMATS = (".stl", ".obj", ".dae")
TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
"""Of a binary STL file, after 80 bytes of text and the number of triangles."""


def vertices_of(path: str | Path) -> Array:
    """(k, 3) vertices of a mesh file as it has them; Collada in m by its <unit>.

    Its <up_axis> is not looked at, as in RViz: the frame of the file is that of the link.

    InputError for a file that cannot be read, has another format or no vertices.
    """
    path = Path(path)
    read = {".stl": _stl, ".obj": _obj, ".dae": _collada}.get(path.suffix.lower())
    if read is None:
        raise InputError(path, f"is no mesh that can be read; expected {', '.join(FORMATS)}")
    try:
        found = read(read_file(path))
    except (ValueError, LookupError, xml.ParseError) as error:
        raise InputError(path, f"cannot be read as a mesh: {error}") from None
    if not len(found) or not np.isfinite(found).all():
        raise InputError(path, "cannot be read as a mesh: has no vertices, or some that are no numbers")
    return np.unique(found, axis=0)


def triangles_of(path: str | Path) -> Array:
    """(k, 3, 3) corners of the triangles of an STL file, in its own unit. InputError where it cannot be read."""
    try:
        found = _stl(read_file(path))
    except ValueError as error:
        raise InputError(path, f"cannot be read as a mesh: {error}") from None
    if not len(found) or len(found) % 3 or not np.isfinite(found).all():
        raise InputError(path, "cannot be read as a mesh: has no triangles, or some that are no numbers")
    return np.asarray(found.reshape(-1, 3, 3), float)


def _stl(data: bytes) -> Array:
    """Binary if the number of triangles fits the length of the file: a binary file may begin with "solid", too."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 and len(data) == 84 + count * TRIANGLE.itemsize:
        return np.frombuffer(data, TRIANGLE, count, 84)["vertices"].reshape(-1, 3).astype(float)
    return _lines(data, "vertex")


def _obj(data: bytes) -> Array:
    return _lines(data, "v")


def _lines(data: bytes, keyword: str) -> Array:
    """(k, 3) the first three numbers of lines that begin with a keyword."""
    rows = (line.split() for line in data.decode("utf-8", "replace").splitlines())
    found = [[float(part) for part in row[1:4]] for row in rows if row and row[0].lower() == keyword]
    if any(len(row) != 3 for row in found):
        raise ValueError(f"a line {keyword!r} has no three numbers")
    return np.array(found, float).reshape(-1, 3)


def _collada(data: bytes) -> Array:
    """Vertices of all geometries, where the nodes of the scene put them."""
    root = xml.fromstring(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    unit = root.find("asset/unit")
    scale = float(unit.get("meter", "1")) if unit is not None else 1.0
    shapes = {one.get("id", ""): _positions(one) for one in root.iter("geometry")}
    named = {one.get("id", ""): one for one in root.iter("node") if one.get("id")}
    scenes = root.findall("library_visual_scenes/visual_scene")
    placed = [points for scene in scenes for node in scene.findall("node") for points in _node(node, shapes, named, 0)]
    return np.asarray(np.concatenate([np.empty((0, 3)), *(placed or shapes.values())]) * scale, float)


def _positions(geometry: xml.Element) -> Array:
    """(k, 3) of the sources that the <vertices> of a geometry name as POSITION."""
    found = [np.empty((0, 3))]
    sources = {one.get("id", ""): one for one in geometry.iter("source")}
    for named in geometry.iter("input"):
        source = sources.get(named.get("source", "").removeprefix("#"))
        if named.get("semantic") == "POSITION" and source is not None:
            numbers = np.array((source.findtext("float_array") or "").split(), float)
            accessor = source.find(".//accessor")
            stride = int(accessor.get("stride", "3")) if accessor is not None else 3
            found.append(numbers.reshape(-1, stride)[:, :3])
    return np.concatenate(found)


def _node(node: xml.Element, shapes: dict[str, Array], named: dict[str, xml.Element], depth: int) -> list[Array]:
    """Vertices under a node in the frame of its parent; nodes that hold each other end at 32 levels."""
    if depth > 32:
        raise ValueError("its nodes hold each other")
    pose, found = np.eye(4), []
    for element in node:
        pose = pose @ _transform(element)
        target = element.get("url", "").removeprefix("#")
        if element.tag == "instance_geometry" and target in shapes:
            found.append(shapes[target])
        elif element.tag == "instance_node" and target in named:
            found += _node(named[target], shapes, named, depth + 1)
        elif element.tag == "node":
            found += _node(element, shapes, named, depth + 1)
    return [points @ pose[:3, :3].T + pose[:3, 3] for points in found]


def _transform(element: xml.Element) -> Array:
    """(4, 4) of <matrix>, <translate>, <rotate> (axis, degrees) and <scale>; of other elements the identity."""
    pose = np.eye(4)
    if element.tag not in ("matrix", "translate", "rotate", "scale"):
        return pose
    values = np.array((element.text or "").split(), float)
    if element.tag == "matrix":
        return np.asarray(values.reshape(4, 4), float)
    if element.tag == "translate":
        pose[:3, 3] = values
    elif element.tag == "scale":
        pose[:3, :3] = np.diag(values)
    else:
        x, y, z = values[:3] / max(float(np.linalg.norm(values[:3])), 1e-300)
        cross, angle = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.deg2rad(values[3])
        pose[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return pose


def mesh_file(path: Path, name: str) -> Path | None:
    """The file of a mesh: beside the URDF file, or in a ROS package among the folders above it; None: it is not there.

    package://NAME/REST means REST in the nearest folder NAME above the URDF file, or beside one of those.
    """
    kind, _, inner = name.rpartition("://")
    if not inner or Path(inner).suffix.lower() not in FORMATS:
        return None
    folder = path.resolve().parent
    places = [folder / inner]
    if kind == "package":
        places = [place for above in (folder, *folder.parents) for place in (above / inner, above.parent / inner)]
    return next((place for place in places if place.is_file()), None)
