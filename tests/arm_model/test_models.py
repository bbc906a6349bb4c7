"""The arms in config/models against printed figures, and through URDF and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body import kinematics, numeric
from arm_model.rigid_body.inertia import about_com, barycentric, transform, unphysical
from arm_model.rigid_body.kinematics import roll_pitch_yaw
from arm_model.simulation.simulation import simulate
from arm_model.system import dynamics
from arm_model.urdf import read_urdf, write_urdf
from tests.arm_model.oracles import forward_dynamics
from tests.arm_model.random_arms import random_arm, random_states


def _columns(path: Path, *groups: tuple[str, ...]) -> list[np.ndarray]:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    table = np.genfromtxt(lines, delimiter=",", names=True)
    return [np.stack([table[name] for name in group], axis=1) for group in groups]


def test_three_link_puma_of_the_thesis(root: Path, shared: Path) -> None:
    arm = read_model(root / "config/models/puma560_thesis.toml")
    q, qd, tau, qdd, entries = _columns(
        shared / "reference/puma3_appendix_c1.csv",
        ("q1", "q2", "q3"),
        ("qd1", "qd2", "qd3"),
        ("tau1", "tau2", "tau3"),
        ("qdd1", "qdd2", "qdd3"),
        ("M11", "M12", "M13", "M22", "M23", "M33"),
    )
    np.testing.assert_allclose(forward_dynamics(arm, q, qd, tau), qdd, rtol=0, atol=1e-8)
    matrix = numeric.mass_matrix(arm, q)
    upper = np.stack([matrix[:, i, j] for i in range(3) for j in range(i, 3)], axis=1)
    np.testing.assert_allclose(upper, entries, rtol=0, atol=1e-8)


def test_scara_of_the_thesis(root: Path, shared: Path) -> None:
    arm = read_model(root / "config/models/scara.toml")
    q, qd, tau, qdd = _columns(
        shared / "reference/scara_appendix_c2.csv",
        ("q1", "q2", "z3"),
        ("qd1", "qd2", "zd3"),
        ("tau1", "tau2", "f3"),
        ("qdd1", "qdd2", "zdd3"),
    )
    np.testing.assert_allclose(forward_dynamics(arm, q, qd, tau), qdd, rtol=0, atol=1e-8)
    np.testing.assert_allclose(dynamics.inverse_dynamics(arm, q, qd, qdd), tau, rtol=0, atol=1e-8)


AA300 = {  # as published: mass, centre, Ixx Iyy Izz Ixy Ixz Iyz about it
    "column": (1123.1, (0.0059, 0.9383, 0.0638), (692.59, 85.08, 699.93, 7.2543, -0.2016, 22.1523)),
    "upper arm": (201.45, (0.3267, 0.3938, 0.4836), (67.57, 49.62, 33.82, 0.0444, -0.0430, -17.8084)),
    "extension tube": (118.95, (0.0012, 0.2900, -0.2111), (18.32, 2.80, 17.52, -0.0511, 0.0292, -1.4355)),
    "gripper": (65.16, (0.0773, 0.2194, -0.0953), (1.1798, 0.6623, 1.2533, 0.0225, -0.0140, 0.0382)),
}


def test_aa300_is_the_published_one(root: Path) -> None:
    arm = read_model(root / "config/models/aa300.toml")
    assert [joint.name for joint in arm.joints] == list(AA300)
    for joint, (mass, com, (xx, yy, zz, xy, xz, yz)) in zip(arm.joints, AA300.values()):
        assert (joint.mass, joint.com, joint.inertia) == (mass, com, (xx, yy, zz, xy, yz, xz))


def test_inverted_pendulum_swings_as_a_pendulum(root: Path) -> None:
    """Hanging, small: w^2 = m g l / (J - (m l)^2 / (M + m)), the cart free."""
    arm = read_model(root / "config/models/cart_pendulum.toml")
    start = np.array([0.0, np.pi - 1e-3])
    motion = simulate(arm, lambda t: np.zeros((len(t), 2)), duration=4.0, rate=1000, start=start)
    m, cart, reach = 0.3, 1.0, 0.25
    inertia = 0.00625 + m * reach**2
    pulsation = np.sqrt(m * 9.80665 * reach / (inertia - (m * reach) ** 2 / (cart + m)))
    np.testing.assert_allclose(np.pi - motion.q[:, 1], 1e-3 * np.cos(pulsation * motion.t), atol=2e-6)


def test_a_reason_is_wanted_for_an_unphysical_set(root: Path, tmp_path: Path) -> None:
    text = (root / "config/models/puma560_thesis.toml").read_text()
    kept = [line for line in text.splitlines() if not line.startswith("unphysical")]
    (tmp_path / "model.toml").write_text("\n".join(kept))
    with pytest.raises(InputError, match="inertia"):
        read_model(tmp_path / "model.toml")


def _bare(arm: Arm) -> Arm:
    """What of an arm goes through URDF."""
    joints = tuple(
        replace(j, rotor_inertia=0.0, offset=0.0, viscous=sum(j.viscous) / 2, coulomb=sum(j.coulomb) / 2)
        for j in arm.joints
    )
    return replace(arm, joints=joints)


@pytest.mark.parametrize("seed", range(6))
def test_urdf_out_and_in(seed: int, tmp_path: Path) -> None:
    arm = _bare(random_arm(seed))
    write_urdf(tmp_path / "arm.urdf", arm)
    back = read_urdf(tmp_path / "arm.urdf")
    back = replace(back, gravity=arm.gravity)
    states = random_states(seed, len(arm))
    np.testing.assert_allclose(kinematics.forward(back, states[0]), kinematics.forward(arm, states[0]), atol=1e-9)
    ours, theirs = (dynamics.inverse_dynamics(a, *states) for a in (arm, back))
    np.testing.assert_allclose(theirs, ours, rtol=1e-8, atol=1e-8)


def test_mujoco_reads_our_urdf(root: Path, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    arm = _bare(read_model(root / "config/models/puma560.toml"))
    write_urdf(tmp_path / "arm.urdf", arm)
    text = (tmp_path / "arm.urdf").read_text()
    text = text.replace('<link name="base" />', "<mujoco><compiler fusestatic='false'/></mujoco><link name=\"base\" />")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    q, qd, qdd = random_states(1, 6, 5)
    expected = numeric.rigid_torque(replace(arm, gravity=(0.0, 0.0, -9.81)), q, qd, qdd)
    for row in range(5):
        data.qpos, data.qvel, data.qacc = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(data.qfrc_inverse, expected[row], rtol=1e-6, atol=1e-6)


def test_fixed_links_are_merged(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(
        """<robot name="r"><link name="world"/><link name="a"><inertial><mass value="2"/>
        <inertia ixx="1" iyy="1" izz="1"/></inertial></link><link name="b"><inertial><mass value="1"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial></link>
        <joint name="j" type="continuous"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/></joint>
        <joint name="f" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/></joint></robot>"""
    )
    arm = read_urdf(tmp_path / "arm.urdf")
    assert len(arm) == 1 and arm.joints[0].mass == 3.0
    assert numeric.mass_matrix(arm, np.zeros(1))[0, 0, 0] == pytest.approx(1 + 0.1 + 0.25)
    assert arm.tool[0][3] == 0.5


def test_prefixes_of_other_tools_need_no_declaration(tmp_path: Path) -> None:
    """As in files that were made for Drake: XML calls them unbound, other readers of URDF take no notice."""
    joint = (
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit {} effort="5" velocity="2"/></joint>'
    )
    body = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    text = f'<robot name="r"><link name="a"/><link name="b">{body}</link>{joint}</robot>'
    (tmp_path / "plain.urdf").write_text(text.format(""))
    (tmp_path / "drake.urdf").write_text(
        text.format('drake:acceleration="2.5"').replace("</robot>", "<drake:x/></robot>")
    )
    assert read_urdf(tmp_path / "drake.urdf") == read_urdf(tmp_path / "plain.urdf")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot", "cannot be read as URDF"),
        ("<sdf/>", "not a URDF"),
        ("<robot><link name='a'/><link name='b'/></robot>", "branches into a, b"),
        ("<robot><macro name='arm'><link name='a'/></macro></robot>", "has no <link> that ends a chain .* xacro FILE"),
        ("<robot><link name='a'/><joint name='j'><parent link='a'/></joint></robot>", "needs <child link"),
    ],
)
def test_bad_urdf_gets_one_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_urdf(tmp_path / "arm.urdf")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("inertia", [(0.0,) * 6, (2e-3, 2e-3, 0.0, 0.0, 0.0, 0.0), (3e-3, 1e-3, 2e-3, 0.0, 0.0, 0.0)])
def test_bodies_at_the_edge_of_what_is_possible_stay_possible_in_other_frames(inertia: tuple[float, ...]) -> None:
    """A mass point, a rod and a plate, seen from frames a metre away: what ``calibrate`` writes, ``model`` reads."""
    random = np.random.default_rng(4)
    for _ in range(50):
        body = barycentric(2.5811357047759587, tuple(random.normal(size=3)), inertia)
        for _ in range(3):
            pose = roll_pitch_yaw(tuple(random.uniform(-3, 3, 3)))
            pose[:3, 3] = random.normal(size=3)
            body = transform(body, pose)
        mass, _, about = about_com(body)
        assert unphysical(mass, about) is None


def test_rounding_of_a_mass_point_that_is_back_at_its_origin_is_no_negative_inertia() -> None:
    assert unphysical(0.034, (-2e-31, -1.7e-18, 1.7e-18, -2.9e-19, -1.3e-18, 1.1e-19)) is None
    assert "not positive" in (unphysical(0.034, (1e-10, 1e-10, -1e-12, 0.0, 0.0, 0.0)) or "")
