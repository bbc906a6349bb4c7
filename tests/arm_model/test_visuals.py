"""Meshes of URDF files: on the right link, in the right place, and only files that are there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_model import read_model
from arm_model.collision import read_chain
from arm_model.rigid_body.kinematics import roll_pitch_yaw
from arm_model.visuals import read_visuals

URDF = """<robot name="two">
  <link name="base"><visual><geometry><mesh filename="package://two_description/meshes/base.stl"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0.1 0 0.2" rpy="0.3 0 0"/>
    <geometry><mesh filename="meshes/upper.STL" scale="0.001 0.001 0.001"/></geometry></visual>
    <visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="flange"><visual><geometry><mesh filename="meshes/flange.dae"/></geometry></visual>
    <visual><geometry><mesh filename="meshes/absent.stl"/></geometry></visual>
    <visual><geometry><mesh filename="../../etc/passwd"/></geometry></visual></link>
  <link name="slide"/>
  <joint name="a" type="revolute"><origin xyz="0 0 0.3" rpy="0 0.2 0"/><axis xyz="0 1 0"/>
    <parent link="base"/><child link="upper"/><limit lower="-1" upper="1" effort="9" velocity="1"/></joint>
  <joint name="b" type="fixed"><origin xyz="0.4 0 0" rpy="0 0 0.5"/><parent link="upper"/><child link="flange"/></joint>
  <joint name="c" type="prismatic"><origin xyz="0 0.1 0"/><axis xyz="1 0 0"/>
    <parent link="flange"/><child link="slide"/>
    <limit lower="0" upper="1" effort="9" velocity="1"/></joint>
</robot>"""


def pose(xyz: tuple[float, float, float], rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = roll_pitch_yaw(rpy)
    matrix[:3, 3] = xyz
    return matrix


def test_meshes_stand_where_the_urdf_puts_them(tmp_path: Path) -> None:
    folder = tmp_path / "two_description/urdf"
    (folder / "meshes").mkdir(parents=True)
    (tmp_path / "two_description/meshes").mkdir()
    for name in ("urdf/meshes/upper.STL", "urdf/meshes/flange.dae", "meshes/base.stl"):
        (tmp_path / "two_description" / name).touch()
    (folder / "two.urdf").write_text(URDF)
    visuals = read_visuals(folder / "two.urdf")
    assert [(one.link, one.file.name) for one in visuals] == [(0, "base.stl"), (1, "upper.STL"), (1, "flange.dae")]
    assert visuals[1].scale == (0.001, 0.001, 0.001) and visuals[2].scale == (1.0, 1.0, 1.0)
    assert len(read_model(folder / "two.urdf").joints) == 2

    # In the base frame at some pose, by the rules of URDF alone.
    chain, q = read_chain(folder / "two.urdf"), 0.7
    frames = chain.frames(np.array([[q, 0.1]]))[0]
    upper = pose((0, 0, 0.3), (0, 0.2, 0)) @ pose((0, 0, 0), (0, q, 0))
    expected = [np.eye(4), upper @ pose((0.1, 0, 0.2), (0.3, 0, 0)), upper @ pose((0.4, 0, 0), (0, 0, 0.5))]
    for one, place in zip(visuals, expected):
        assert np.allclose(frames[one.link] @ one.pose, place, atol=1e-12)


def test_other_models_have_none(root: Path) -> None:
    assert read_visuals(root / "config/models/puma560.toml") == ()
