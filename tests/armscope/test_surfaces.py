"""The meshes of an animation: where the URDF file puts them, thinned, and drawn."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from arm_io import InputError
from arm_model import read_model
from arm_model.meshes import TRIANGLE
from armscope.animation import MEASURED
from armscope.animation.surfaces import MOST, capsule_surfaces, capsule_triangles, read_surfaces, thinned
from armscope.cli import run
from daq.recording import Attachments, write_table

URDF = """<robot name="one"><link name="world"/>
<joint name="turn" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/><origin xyz="0 0 0.5"/></joint>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" iyz="0" ixz="0"/></inertial>
  <visual><origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/>
    <geometry><mesh filename="ball.stl" scale="0.001 0.001 0.001"/></geometry></visual>
</link></robot>
"""


def ball(rings: int) -> np.ndarray:
    """(k, 3, 3) triangles of a sphere of 400 mm, stretched to twice its width along x."""
    polar, around = np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, 2 * rings)
    p, a = np.meshgrid(polar, around, indexing="ij")
    points = 400 * np.stack([2 * np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1)
    first = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:]], axis=-2).reshape(-1, 3, 3)
    second = np.stack([points[:-1, :-1], points[1:, 1:], points[:-1, 1:]], axis=-2).reshape(-1, 3, 3)
    return np.concatenate([first, second])


@pytest.fixture
def model(tmp_path: Path) -> Path:
    rows = np.zeros(len(triangles := ball(30)), TRIANGLE)
    rows["vertices"] = triangles
    (tmp_path / "ball.stl").write_bytes(
        b"solid in name only".ljust(80) + len(rows).to_bytes(4, "little") + rows.tobytes()
    )
    (tmp_path / "arm.urdf").write_text(URDF)
    return tmp_path / "arm.urdf"


def test_a_mesh_stands_where_the_file_puts_it(model: Path) -> None:
    (surface,) = read_surfaces(model)
    corners = surface.triangles.reshape(-1, 3)
    assert surface.link == 1 and 100 < len(surface.triangles) <= MOST + 12
    # 0.8 m along x of the mesh, which is y of the link, and 0.4 m along x, round (0.5, 0, 0)
    np.testing.assert_allclose(corners.max(axis=0), [0.9, 0.8, 0.4], atol=0.05)
    np.testing.assert_allclose(corners.min(axis=0), [0.1, -0.8, -0.4], atol=0.05)
    around = surface.corners(np.broadcast_to(np.eye(4), (3, 2, 4, 4)))
    assert around.shape == (3, 8, 3)
    np.testing.assert_allclose(around[1].max(axis=0), corners.max(axis=0))
    assert read_surfaces(None) == () and read_surfaces(Path("config/models/scara.toml")) == ()


@pytest.mark.parametrize("most", [40, 200, 1000, 10**6])
def test_what_is_thinned_keeps_its_shape(most: int) -> None:
    whole = ball(40)
    few = thinned(whole, most)
    assert len(few) <= most and (most < len(whole) or few is whole)
    away = np.abs(np.linalg.norm(few.reshape(-1, 3) / [2, 1, 1], axis=1) - 400)
    assert away.max() < (240 if most < 100 else 130)


def test_a_torn_mesh_is_refused_in_one_line(model: Path) -> None:
    (model.parent / "ball.stl").write_text("solid x\nvertex 1 2\n")
    with pytest.raises(InputError, match=r"ball.stl.*mesh"):
        read_surfaces(model)


def test_the_mesh_is_seen_in_the_animation(model: Path, tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    t = np.arange(200) * 0.001
    q = 3 * t[:, None]
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": q}, Attachments())
    share = []
    for name in ("arm.urdf", "bare.urdf"):
        (tmp_path / "bare.urdf").write_text(URDF.replace("ball.stl", "absent.stl"))
        out = tmp_path / f"{name}.gif"
        assert run(["plot", str(tmp_path / "run.mcap"), "--animate", str(out), "--model", str(tmp_path / name)]) == 0
        with image.open(BytesIO(out.read_bytes())) as film:
            pixels = np.asarray(film.convert("RGB"), float)
        # of the arm's colour, lighter or darker
        colour = np.array(to_rgb(MEASURED)) - np.mean(to_rgb(MEASURED))
        tint = pixels / 255 - pixels.mean(axis=2, keepdims=True) / 255
        share.append(float(np.mean(tint @ colour > 0.3 * colour @ colour)))
    assert share[0] > 5 * share[1] > 0


@pytest.mark.parametrize("end", [(0.3, -0.2, 0.5), (0.1, 0.0, 0.9), (0.1, 0.0, 0.2)])
def test_corners_of_a_capsule_are_on_its_surface(end: tuple[float, float, float]) -> None:
    start = np.array([0.1, 0.0, 0.2])
    corners = capsule_triangles(start, np.array(end), 0.07).reshape(-1, 3)
    along = np.array(end) - start
    share = np.clip((corners - start) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    np.testing.assert_allclose(np.linalg.norm(corners - start - share[:, None] * along, axis=1), 0.07, rtol=1e-9)


def test_stated_capsules_are_drawn_and_assumed_ones_are_not(root: Path) -> None:
    assert [one.link for one in capsule_surfaces(read_model(root / "config/models/aa300.toml"))] == [
        0,
        1,
        2,
        3,
        4,
        4,
        4,
    ]
    assert capsule_surfaces(read_model(root / "config/models/puma560.toml")) == ()
