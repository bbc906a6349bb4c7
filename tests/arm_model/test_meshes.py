"""Collision meshes of URDF files: read from hand-made files, enclosed by capsules, beside MuJoCo's reading of them."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from arm_io import InputError
from arm_model.capsules import round_points
from arm_model.collision import chain_of
from arm_model.meshes import vertices_of
from arm_model.tables.link_shapes import Capsule
from arm_model.urdf import Use, read_urdf, urdf_gaps
from armscope.cli import run
from tests.arm_clearance.arms import ur5_urdf

# a wedge: two triangles at its ends, m
CORNERS = np.array(
    [
        [0.02, -0.05, 0.0],
        [0.05, 0.05, 0.0],
        [-0.06, 0.01, 0.01],
        [0.03, -0.04, 0.41],
        [0.04, 0.05, 0.4],
        [-0.05, 0, 0.4],
    ]
)
FACES = ((0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5))


def binary_stl(path: Path, corners: np.ndarray = CORNERS) -> Path:
    """With a header that begins as a text file's does."""
    data = b"solid exported by a program".ljust(80, b" ") + struct.pack("<I", len(FACES))
    for face in FACES:
        data += struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0)
    path.write_bytes(data)
    return path


def text_stl(path: Path) -> Path:
    text = ["solid wedge"]
    for face in FACES:
        text += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in CORNERS[list(face)])]
        text += ["endloop", "endfacet"]
    path.write_text("\n".join([*text, "endsolid wedge"]))
    return path


def obj(path: Path) -> Path:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + ["vn 0 0 1", "vt 0 0"]
    path.write_text("# wedge\n" + "\n".join(lines + [f"f {a + 1}//1 {b + 1}//1 {c + 1}//1" for a, b, c in FACES]))
    return path


def collada(path: Path) -> Path:
    """In mm, shifted by 1 m and turned by 90 degrees about z by the nodes of the scene, which undo what is written."""
    written = np.stack([CORNERS[:, 1], -CORNERS[:, 0], CORNERS[:, 2] - 1.0], axis=1) * 1000
    numbers = " ".join(repr(float(value)) for value in written.ravel())
    path.write_text(
        f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="18">{numbers}</float_array>
<technique_common><accessor source="#a" count="6" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="outer"><translate>0 0 1000</translate>
<node id="inner"><rotate>0 0 1 90</rotate><instance_geometry url="#g"/></node></node></visual_scene>
</library_visual_scenes>
</COLLADA>"""
    )
    return path


@pytest.mark.parametrize(
    ("write", "name"), [(binary_stl, "w.STL"), (text_stl, "w.stl"), (obj, "w.obj"), (collada, "w.dae")]
)
def test_every_format_gives_the_same_vertices(tmp_path: Path, write, name: str) -> None:
    found = vertices_of(write(tmp_path / name))
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(CORNERS, axis=0), atol=1e-7)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.stl", b"solid nothing\nendsolid\n"),
        ("a.stl", b"facet\nvertex 1 2\n"),
        ("a.obj", b"v 1 2 nan\n"),
        ("a.dae", b"<COLLADA>"),
        ("a.dae", b"<COLLADA><node/></COLLADA>"),
    ],
)
def test_a_broken_mesh_is_refused_in_one_line(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match="cannot be read as a mesh") as caught:
        vertices_of(tmp_path / name)
    assert "\n" not in str(caught.value)


@settings(max_examples=100)
@given(st.sampled_from([".stl", ".obj", ".dae"]), st.binary(max_size=300))
def test_whatever_bytes_a_mesh_has_are_refused_or_read(tmp_path_factory, ending: str, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / f"any{ending}"
    path.write_bytes(data)
    with suppress(InputError):
        assert vertices_of(path).shape[1] == 3


def outside(capsule: Capsule, points: np.ndarray) -> float:
    """m by which the furthest of points (k, 3) is outside, by a fine walk along the segment."""
    along = np.linspace(0.0, 1.0, 2001)[:, None]
    segment = np.array(capsule.start) * (1 - along) + np.array(capsule.end) * along
    nearest = np.array([np.linalg.norm(segment - point, axis=1).min() for point in points])
    length = float(np.linalg.norm(np.subtract(capsule.end, capsule.start)))
    return float((nearest - capsule.radius).max()) - length / 2000


@settings(max_examples=6)
@given(arrays(float, st.tuples(st.integers(1, 12), st.just(3)), elements=st.floats(-1, 1, width=32)))
def test_a_capsule_encloses_its_points(points: np.ndarray) -> None:
    assert outside(round_points(points), points) <= 1e-6


def test_the_capsule_round_points_of_a_capsule_is_hardly_larger() -> None:
    random = np.random.default_rng(3)
    for _ in range(3):
        start, end, radius = random.normal(size=3), random.normal(size=3), 0.1
        sphere = random.normal(size=(600, 3))
        sphere *= radius / np.linalg.norm(sphere, axis=1)[:, None]
        points = np.concatenate([start + sphere[:300], end + sphere[300:]])
        found = round_points(points)
        assert outside(found, points) <= 1e-6
        assert found.radius < 1.08 * radius
        assert np.linalg.norm(np.subtract(found.end, found.start)) < 1.1 * np.linalg.norm(end - start)


def meshed(folder: Path) -> Path:
    """A UR5 with the wedge in mm at its forearm, in a ROS package, and one mesh that is missing."""
    (folder / "arm_description/meshes").mkdir(parents=True)
    (folder / "arm_description/urdf").mkdir()
    binary_stl(folder / "arm_description/meshes/forearm.stl", 1000 * CORNERS)
    forearm = (
        '<collision><origin xyz="-0.1 0.02 0" rpy="0.3 1.2 -0.4"/><geometry>'
        '<mesh filename="package://arm_description/meshes/forearm.stl" scale="0.001 0.001 0.001"/></geometry>'
        "</collision>"
    )
    missing = (
        '<collision><geometry><mesh filename="package://arm_description/meshes/upper.stl"/></geometry></collision>'
    )
    return ur5_urdf(folder / "arm_description/urdf/arm.urdf", {3: forearm, 2: missing})


def test_links_are_kept_clear_by_capsules_round_their_meshes(tmp_path: Path) -> None:
    """MuJoCo reads the file and the mesh and moves the arm by itself: no vertex is outside the capsule of its link."""
    path = meshed(tmp_path)
    chain = chain_of(read_urdf(path))
    assert [body.link for body in chain.bodies if not body.assumed] == [3]
    (number,) = (k for k, body in enumerate(chain.bodies) if body.link == 3)
    text = path.read_text().replace("package://arm_description/meshes/upper.stl", "forearm.stl")
    text = text.replace("package://arm_description/meshes/", "").replace(
        '<robot name="ur5">', '<robot name="ur5"><mujoco><compiler discardvisual="false"/></mujoco>'
    )
    assets = {"forearm.stl": (tmp_path / "arm_description/meshes/forearm.stl").read_bytes()}
    model = mujoco.MjModel.from_xml_string(text, assets)
    data = mujoco.MjData(model)
    (geom,) = (g for g in range(model.ngeom) if mujoco.mj_id2name(model, 1, model.geom_bodyid[g]) == "l3")
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    own = model.mesh_vert[first : first + count]
    for q in np.random.default_rng(1).uniform(-3, 3, (5, 6)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        world = own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        points = chain.points(q[None])[0]
        start, end = points[number], points[len(chain.bodies) + number]
        capsule = Capsule(tuple(start.tolist()), tuple(end.tolist()), chain.bodies[number].radius)
        assert -0.01 < outside(capsule, world) <= 1e-6


def gripped(folder: Path) -> Path:
    """One link whose mesh is missing, with a gripper fixed to it; a second link without <inertial> and shape."""
    path = folder / "gripped.urdf"
    inertial = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1"/></inertial>'
    own = '<collision><geometry><mesh filename="own.stl"/></geometry></collision>'
    seen = '<visual><geometry><mesh filename="seen.dae"/></geometry></visual>'
    ball = '<collision><origin xyz="0 0.3 0"/><geometry><sphere radius="0.04"/></geometry></collision>'
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}"/>{5}</joint>'
    turning = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="1"/>'
    path.write_text(
        f'<robot name="gripped"><link name="base"/><link name="upper">{inertial}{own}{seen}</link>'
        f'<link name="light"/><link name="gripper">{ball}</link>'
        + joint.format("j1", "revolute", "base", "upper", "0 0 0.5", turning)
        + joint.format("j2", "revolute", "upper", "light", "0.4 0 0", turning)
        + joint.format("g", "fixed", "upper", "gripper", "0.2 0 0", "")
        + "</robot>"
    )
    return path


def test_what_is_fixed_to_a_link_does_not_stand_in_for_its_missing_mesh(tmp_path: Path) -> None:
    """The segment of the link is kept clear as well as the gripper on it, whose shape is known."""
    text = gripped(tmp_path).read_text()
    (chained := tmp_path / "chained.urdf").write_text(
        # the gripper between the two links: a fixed joint of the chain
        text.replace('<parent link="upper"/><child link="light"/>', '<parent link="gripper"/><child link="light"/>')
    )
    bodies = [body for body in chain_of(read_urdf(chained)).bodies if body.link == 1]
    assert [body.radius for body in bodies] == [pytest.approx(0.05 * 1.1), 0.04]
    np.testing.assert_allclose(bodies[0].end - bodies[0].start, [0.6, 0.0, 0.0], atol=1e-12)


def test_a_link_without_inertia_and_pictures_that_are_missing_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = gripped(tmp_path)
    assert run(["model", str(path), "--tip", "light"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and all(line.startswith(f"note: {path}: ") for line in said)
    assert "link light has no <inertial>" in said[0] and "own.stl of <collision> is not there" in said[1]
    assert urdf_gaps(path, {Use.PICTURE}) == [
        "seen.dae of <visual> is not there or not STL, OBJ, DAE: these links are drawn as capsules or lines from joint "
        "to joint"
    ]
    assert urdf_gaps(tmp_path / "arm.toml", set(Use)) == []


def test_a_missing_mesh_is_named_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = meshed(tmp_path)
    assert run(["model", str(path)]) == 0
    assert "upper.stl" in capsys.readouterr().err
    assert run(["model", str(path), "--out", str(tmp_path / "arm.toml")]) == 0
    said = capsys.readouterr().err
    assert "upper.stl" in said and "forearm.stl" not in said
    assert run(["excite", "--model", str(path), "--out", str(tmp_path / "e.toml"), "--floor", "-0.5", *SHORT]) == 0
    assert "upper.stl" in capsys.readouterr().err


SHORT = ("--duration", "3", "--fundamental", "0.5", "--harmonics", "2", "--candidates", "32")
