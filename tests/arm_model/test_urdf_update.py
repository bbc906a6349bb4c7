"""A URDF file comes back with only the identified numbers changed."""

from __future__ import annotations

import difflib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from arm_model import Arm, read_model, write_model
from arm_model.rigid_body import drive_mass_matrix
from arm_model.urdf import update_urdf
from armscope.cli import run

URDF = """<?xml version="1.0"?>
<!-- made by hand, do not lose this -->
<robot name='my arm' xmlns:xacro="http://ros.org/wiki/xacro">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
\t<link name="upper">
    <visual><geometry><mesh filename="package://arm/upper.dae" scale="1 1 1"/></geometry></visual>
    <inertial>
      <origin rpy="0.3 -0.2 0.1" xyz="0.1 0 0.05"/>  <!-- from CAD -->
      <inertia izz="0.03" ixx='0.01' iyy="0.025" ixy="0" ixz="0.001" iyz="0"/>
      <mass   value = "2.5" />
    </inertial>
  </link>
  <joint type="revolute" name="shoulder">
    <axis xyz="0 0 1"/><parent link="world"/><child link="upper"/>
    <limit effort="50" lower="-2" upper="2" velocity="3"/>
    <origin xyz="0 0 0.3"/>
  </joint>
  <joint name="plate_fixed" type="fixed">
    <parent link="upper"/><child link="plate"/><origin xyz="0.2 0 0" rpy="0 0 0.5"/></joint>
  <link name="plate"><inertial><mass value="0.4"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="2e-3" ixy="0" iyz="0" ixz="0"/></inertial></link>
  <joint name="elbow" type="continuous">
    <dynamics friction="0.2" damping="0.7"/>
    <origin rpy="1.5707963267948966 0 0" xyz="0.3 0 0"/><parent link="plate"/><child link="lower"/>
    <axis xyz="0 1 0"/>
  </joint>
  <link name="lower"><inertial><mass value="1.2"/><origin xyz="0 0 0.2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.004" ixy="0" iyz="0" ixz="0"/></inertial></link>
</robot>
"""


@pytest.fixture
def original(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_bytes(URDF.replace("\n", "\r\n").encode())
    return path


def close(one: Arm, other: Arm) -> None:
    for a, b in zip(one.joints, other.joints, strict=True):
        for name in ("mass", "com", "inertia", "viscous", "coulomb", "xyz", "rpy"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-7, atol=1e-9, err_msg=name)


def test_without_a_change_every_byte_stays(original: Path, tmp_path: Path) -> None:
    write_model(tmp_path / "arm.toml", read_model(original))
    assert run(["model", str(tmp_path / "arm.toml"), "--into", str(original), "--out", str(tmp_path / "new.urdf")]) == 0
    assert (tmp_path / "new.urdf").read_bytes() == original.read_bytes()


def test_only_the_numbers_of_a_changed_link_change(original: Path, tmp_path: Path) -> None:
    arm = read_model(original)
    changed = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], mass=1.5, viscous=(0.9, 0.9))))
    write_model(tmp_path / "arm.toml", changed)
    assert run(["model", str(tmp_path / "arm.toml"), "--into", str(original), "--out", str(tmp_path / "new.urdf")]) == 0
    before, after = (path.read_bytes().decode() for path in (original, tmp_path / "new.urdf"))
    removed = [line[2:] for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line.startswith("- ")]
    assert len(removed) == 2 and 'damping="0.7"' in removed[0] and '<link name="lower">' in removed[1]
    assert 'damping="0.9"' in after and 'mass value="1.5"' in after and "\r\n" in after
    close(read_model(tmp_path / "new.urdf"), changed)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_random_numbers_come_back(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Of every kind, with links that take the place of what is fixed to them; all else is word for word the same."""
    folder = tmp_path_factory.mktemp("urdf")
    (folder / "arm.urdf").write_text(URDF)
    rng, arm = np.random.default_rng(seed), read_model(folder / "arm.urdf")
    joints = []
    for joint in arm.joints:
        points = rng.normal(scale=0.1, size=(20, 3))
        scatter = points.T @ points / 20
        tensor = np.trace(scatter) * np.eye(3) - scatter
        mass = float(rng.uniform(0.1, 5))
        inertia = tuple(float(mass * tensor[a, b]) for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)))
        friction = {name: (value, value) for name, value in zip(("viscous", "coulomb"), rng.uniform(0, 2, 2).tolist())}
        moved = {"xyz": tuple(rng.normal(size=3).tolist()), "rpy": tuple(rng.uniform(-1, 1, 3).tolist())}
        joints.append(
            replace(joint, mass=mass, com=tuple(rng.normal(size=3).tolist()), inertia=inertia, **friction, **moved)
        )
    changed = replace(arm, joints=tuple(joints))
    update_urdf(folder / "arm.urdf", changed, folder / "new.urdf")
    close(read_model(folder / "new.urdf"), changed)
    kept = [
        re.sub(r"\s+", "", re.sub(r"<dynamics[^>]*>|<origin[^>]*>|=\s*(\"[^\"]*\"|'[^']*')", "", text))
        for text in (URDF, (folder / "new.urdf").read_text())
    ]
    assert kept[0] == kept[1]


def test_mujoco_reads_the_same_arm(original: Path, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    arm = read_model(original)
    changed = replace(
        arm, joints=(replace(arm.joints[0], mass=3.5, com=(0.2, 0.05, 0.0)), replace(arm.joints[1], mass=0.8))
    )
    update_urdf(original, changed, tmp_path / "new.urdf")
    text = re.sub(r"<visual>.*?</visual>", "", (tmp_path / "new.urdf").read_text())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(0).uniform(-1, 1, (5, 2)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        full = np.zeros((2, 2))
        mujoco.mj_fullM(model, data, full) if mujoco.__version__ >= "4" else mujoco.mj_fullM(model, full, data.qM)
        np.testing.assert_allclose(full, drive_mass_matrix(changed, q)[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('name="elbow"', 'name="other"', "has the joints shoulder, other; the model has shoulder, elbow"),
        ("</robot>", "", "cannot be read as"),
        ("<robot", "<model", "cannot be read|not a URDF"),
    ],
)
def test_another_file_is_refused(old: str, new: str, complaint: str, original: Path, tmp_path: Path) -> None:
    arm = read_model(original)
    original.write_text(URDF.replace(old, new))
    with pytest.raises(InputError, match=complaint):
        update_urdf(original, arm, tmp_path / "new.urdf")
    assert not (tmp_path / "new.urdf").exists()


@settings(max_examples=50)
@given(place=st.integers(0, len(URDF) - 1), junk=st.binary(max_size=3))
def test_torn_files_are_refused_in_one_line_or_read(
    place: int, junk: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("urdf") / "arm.urdf"
    data = URDF.encode()
    path.write_bytes(data)
    arm = read_model(path)
    path.write_bytes(data[:place] + junk + data[place + 1 :])
    try:
        update_urdf(path, arm, path.with_name("new.urdf"))
    except InputError as error:
        assert "\n" not in str(error)
