"""URDF files as packages have them: base frames, tool frames, cameras and grippers beside the chain of an arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.branches import joints_of_arm
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


def massless(name: str) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="0"/><inertia ixx="0.05" iyy="0.06" izz="0.03"/></inertial></link>'
    )


def test_inertia_without_mass_is_judged_of_the_whole_that_moves(tmp_path: Path) -> None:
    """As in simulators' files, whose base has no mass so that it stands still; MuJoCo and PyBullet read them."""
    arm = read_urdf(written(tmp_path, ARM))
    base = [massless("base") if part == link("base") else part for part in ARM]
    assert read_urdf(written(tmp_path, base)) == arm
    flange = [massless("flange") if part == link("flange") else part for part in ARM]
    heavier = read_urdf(written(tmp_path, flange)).joints[1]
    assert sum(heavier.inertia[:3]) == pytest.approx(sum(arm.joints[1].inertia[:3]) + 0.14)
    alone = [massless("upper") if part == link("upper", 3.0, 0.05) else part for part in ARM[:-4]]
    with pytest.raises(InputError, match="joint 'base_upper' moves, with what is fixed to it: inertia without mass"):
        read_urdf(written(tmp_path, alone))


def test_fingers_count_as_fixed_where_the_file_places_them(tmp_path: Path) -> None:
    fixed = [part.replace('type="prismatic"', 'type="fixed"') for part in FINGERS]
    expected = read_urdf(written(tmp_path, ARM + fixed), tip="tool0")
    path = written(tmp_path, ARM + FINGERS)
    assert read_urdf(path) == read_urdf(path, tip="tool0") == expected != read_urdf(path, tip="camera")
    said = "are not part of the chain to tool0: counted as fixed where the file places them, with 0.1 kg"
    assert urdf_gaps(path, {Use.DYNAMICS}) == [f"hand_left, hand_right {said}"]
    # a hand without a frame for tools: the tool is the link that the fingers are on
    path = written(tmp_path, [part for part in ARM + FINGERS if "tool0" not in part])
    assert read_urdf(path) == read_urdf(path, tip="hand")


def test_a_joint_of_the_chain_that_follows_another_is_said(tmp_path: Path) -> None:
    following = joint("upper", "fore", "revolute", "0 1 0").replace("</joint>", '<mimic joint="base_upper"/></joint>')
    path = written(tmp_path, [part if "upper_fore" not in part else following for part in ARM])
    assert read_urdf(path, tip="tool0") == read_urdf(written(tmp_path, ARM), tip="tool0")
    path = written(tmp_path, [part if "upper_fore" not in part else following for part in ARM])
    (said,) = urdf_gaps(path, {Use.DYNAMICS}, tip="tool0")
    assert said.startswith("upper_fore follows base_upper (<mimic>): read as a joint of its own")
    assert urdf_gaps(written(tmp_path, ARM), {Use.DYNAMICS}, tip="tool0") == []


def test_a_camera_that_turns_beside_the_wrist_is_no_hand(tmp_path: Path) -> None:
    path = written(tmp_path, [*ARM, link("lens", 0.3), joint("upper", "lens", "revolute")])
    with pytest.raises(InputError, match=r"branches into tool0, lens; name the tip: armscope model FILE --tip LINK"):
        read_urdf(path)
    assert sum(one.mass for one in read_urdf(path, tip="tool0").joints) == pytest.approx(6.5)


def test_a_loop_of_joints_is_refused(tmp_path: Path) -> None:
    loop = [link("one"), link("two"), joint("one", "two", "revolute"), joint("two", "one", "revolute")]
    with pytest.raises(InputError, match="link 'two' is behind itself; expected a tree"):
        read_urdf(written(tmp_path, ARM + loop), tip="two")


def test_what_moves_on_the_base_is_not_the_arms(tmp_path: Path) -> None:
    path = written(tmp_path, [*ARM, link("wheel", 4.0), joint("base", "wheel", "continuous")])
    with pytest.raises(InputError, match="branches into tool0, wheel"):
        read_urdf(path)
    assert read_urdf(path, tip="tool0") == read_urdf(written(tmp_path, ARM))
    path = written(tmp_path, [*ARM, link("wheel", 4.0), joint("base", "wheel", "continuous")])
    assert urdf_gaps(path, {Use.DYNAMICS}, tip="tool0") == ["base_wheel is beside the arm on its base: left out"]


@pytest.mark.parametrize(
    ("chains", "count"),
    [
        (["", "abc"], 3),
        (["abc", "ab", "abc"], 3),
        (["abcx", "abcy"], 3),
        (["abcx", "abcy", "abc", "a"], 3),
        (["abcxX", "abcyY", "abcz", "abcw"], 3),  # two fingers of two joints, two of one
        (["abcxX", "abcy"], None),  # a wrist and a camera
        (["abx", "abcde"], None),
        (["xa", "yb"], None),  # two arms
        (["abxyz", "abuvw"], None),  # two arms on a torso
        (["", ""], None),
        ([], None),
    ],
)
def test_the_arm_among_chains(chains: list[str], count: int | None) -> None:
    assert joints_of_arm(chains) == count


def test_an_identified_mass_comes_back_beside_fingers(tmp_path: Path) -> None:
    path = written(tmp_path, ARM + FINGERS)
    arm = read_urdf(path)
    fore = replace(arm.joints[1], mass=1.1 * arm.joints[1].mass, inertia=tuple(1.1 * v for v in arm.joints[1].inertia))
    update_urdf(path, replace(arm, joints=(arm.joints[0], fore)), tmp_path / "out.urdf")
    back = read_urdf(tmp_path / "out.urdf").joints[1]
    assert back.mass == pytest.approx(fore.mass) and back.com == pytest.approx(fore.com)
    with pytest.raises(InputError, match=r"link 'fore': 0.03 kg are not possible .*: without that its mass -0"):
        light = replace(arm.joints[1], mass=0.03)
        update_urdf(path, replace(arm, joints=(arm.joints[0], light)), tmp_path / "light.urdf")
    assert not (tmp_path / "light.urdf").exists()
    with pytest.raises(InputError, match=r"the model has \w+; --tip LINK names the arm's last link$"):
        update_urdf(path, replace(arm, joints=arm.joints[:1]), tmp_path / "short.urdf")


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


def test_what_does_not_move_may_have_any_inertia(tmp_path: Path) -> None:
    """Antennas on the base of a package's robot have a tensor that no body has; no torque depends on it."""
    impossible = (
        '<link name="antenna"><inertial><mass value="1e-6"/><inertia ixx="2.371e-8" ixy="6.119e-8" ixz="1.179e-8" '
        'iyy="2.833e-8" iyz="7.74e-9" izz="3.849e-8"/></inertial></link>'
    )
    arm = read_urdf(written(tmp_path, [*ARM, impossible, joint("base", "antenna")]))
    assert arm == read_urdf(written(tmp_path, ARM))
    with pytest.raises(InputError, match="link 'antenna': inertia is not positive"):
        read_urdf(written(tmp_path, [*ARM, impossible, joint("fore", "antenna")]))
