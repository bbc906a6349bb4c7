"""URDF files as packages have them: base frames, tool frames, cameras and grippers beside the chain of an arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.rigid_body import numeric
from arm_model.urdf import Use, read_urdf, update_urdf, urdf_gaps
from tests.arm_model.random_arms import random_states


def link(name: str, mass: float = 0.0, x: float = 0.0) -> str:
    inertial = (
        f'<inertial><origin xyz="{x} 0.02 0.1" rpy="0.1 0.2 0.3"/><mass value="{mass}"/>'
        f'<inertia ixx="{0.02 * mass}" iyy="{0.03 * mass}" izz="{0.025 * mass}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    return f'<link name="{name}">{inertial if mass else ""}</link>'


def joint(parent: str, child: str, kind: str = "fixed", axis: str = "0 0 1", xyz: str = "0.1 0.2 0.3") -> str:
    return (
        f'<joint name="{parent}_{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0.4 0.5 0.6"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="10" velocity="2"/></joint>'
    )


ARM = [
    *(link(name, mass, 0.05) for name, mass in (("upper", 3.0), ("fore", 2.0), ("hand", 0.6))),
    *(link(name) for name in ("base", "frame", "flange", "tool0")),
    joint("base", "frame"),
    joint("base", "upper", "revolute"),
    joint("upper", "fore", "revolute", "0 1 0"),
    joint("fore", "flange", xyz="0 0 0.2"),
    joint("flange", "hand"),
    joint("flange", "tool0", xyz="0 0 0.05"),
    # a camera and its cable on the upper arm
    *(link("camera", 0.4, 0.1), link("cable", 0.2)),
    joint("upper", "camera"),
    joint("camera", "cable"),
]
FINGERS = [
    *(link(name, 0.05) for name in ("left", "right")),
    joint("hand", "left", "prismatic"),
    joint("hand", "right", "prismatic"),
]


def written(folder: Path, parts: list[str]) -> Path:
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
    return path


def test_the_only_chain_that_moves_is_the_arm_with_all_that_is_fixed_to_it(tmp_path: Path) -> None:
    """As MuJoCo has it, which merges what is fixed."""
    mujoco = pytest.importorskip("mujoco")
    path = written(tmp_path, ARM)
    arm = read_urdf(path)
    assert [one.name for one in arm.joints] == ["base_upper", "upper_fore"]
    assert sum(one.mass for one in arm.joints) == pytest.approx(6.2)
    assert arm == read_urdf(path, tip="tool0") != read_urdf(path, tip="hand")
    model = mujoco.MjModel.from_xml_string(path.read_text())
    data = mujoco.MjData(model)
    q, qd, qdd = random_states(1, 2, 5)
    expected = numeric.rigid_torque(replace(arm, gravity=(0.0, 0.0, -9.81)), q, qd, qdd)
    for row in range(5):
        data.qpos, data.qvel, data.qacc = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(data.qfrc_inverse, expected[row], rtol=1e-6, atol=1e-6)
    assert urdf_gaps(path, {Use.DYNAMICS}) == ["the tool frame is tool0; --tip takes hand instead"]
    assert urdf_gaps(path, {Use.DYNAMICS}, tip="hand") == []


def test_of_what_moves_beside_the_way_to_the_tip_the_mass_is_said(tmp_path: Path) -> None:
    path = written(tmp_path, ARM + FINGERS)
    with pytest.raises(InputError, match=r"branches into frame, tool0, cable, left, right; name the tip"):
        read_urdf(path)
    assert read_urdf(path, tip="tool0") == read_urdf(written(tmp_path, ARM))
    path = written(tmp_path, ARM + FINGERS)
    said = ["hand_left, hand_right are beside the way to tool0: left out, with 0.1 kg"]
    assert urdf_gaps(path, {Use.DYNAMICS}, tip="tool0") == said


def test_an_identified_mass_comes_back_beside_a_camera(tmp_path: Path) -> None:
    """The link has the difference, the camera its own; where that were no body, the link has all."""
    path = written(tmp_path, ARM)
    arm = read_urdf(path)
    for factor in (1.1, 0.1):
        upper = replace(arm.joints[0], mass=factor * arm.joints[0].mass)
        upper = replace(upper, inertia=tuple(factor * one for one in upper.inertia))
        update_urdf(path, replace(arm, joints=(upper, arm.joints[1])), tmp_path / "out.urdf")
        back = read_urdf(tmp_path / "out.urdf").joints[0]
        assert back.mass == pytest.approx(upper.mass) and back.com == pytest.approx(upper.com)
        assert back.inertia == pytest.approx(upper.inertia, rel=1e-6, abs=1e-9)
        assert ('mass value="0.4"' in (tmp_path / "out.urdf").read_text()) == (factor > 1)
