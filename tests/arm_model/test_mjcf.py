"""MuJoCo models: read as MuJoCo reads them, and given back with only the identified numbers changed."""

from __future__ import annotations

import difflib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from arm_model import Arm, read_model, write_model
from arm_model.description import Joint
from arm_model.mjcf import mjcf_gaps, update_mjcf
from arm_model.system.inverse import torque_with_effects
from armscope.cli import run

mjcf_arms = pytest.importorskip("tests.arm_model.mjcf_arms", reason="needs mujoco", exc_type=ImportError)

ARM = """<?xml version="1.0"?>
<!-- made by hand, do not lose this -->
<mujoco model='two arm'>
  <compiler angle="radian" meshdir="assets" autolimits="true"/>
  <option gravity="0 0 -9.81"/>
  <default>
    <default class="arm">
      <joint damping="1.5" armature="0.1" range="-2.8 2.8"/>
      <default class="small"><joint  armature="0.02"  frictionloss='0.3'/></default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="base" childclass="arm"> <!-- stands on the table -->
      <inertial mass="3" pos="0 0 0.1" diaginertia="0.01 0.01 0.01"/>
\t<body name="upper" pos="0 0 0.3" quat="1 0 0.2 0">
        <inertial  pos="0.1 0 0.05"   mass = "2.5" quat="0.9 0.1 0.2 0"  diaginertia="0.03 0.025 0.011"/>
        <joint name="shoulder" axis="0 0 1"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0" contype="0"/>
        <body name="plate" pos="0.2 0 0"><inertial mass="0.4" pos="0 0 0" diaginertia="1e-3 1e-3 2e-3"/></body>
        <include file="forearm.xml"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m1" joint="shoulder" gear="100"/></actuator>
</mujoco>
"""
FOREARM = """<mujocoinclude>
  <!-- the forearm -->
  <body name="lower" pos="0.3 0 0" euler="1.5708 0 0">
    <joint name="elbow" class="small" axis="0 1 0" pos="0 0 0.02"
           range="-1 2"/>
    <inertial pos="0 0 0.2" mass="1.2" fullinertia="0.02 0.021 0.004 0.001 0 0.0005"/>
    <site name="tip" pos="0 0 0.4"/>
  </body>
</mujocoinclude>
"""


@pytest.fixture
def original(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_bytes(ARM.replace("\n", "\r\n").encode())
    (tmp_path / "forearm.xml").write_text(FOREARM)
    return path


def agree(path: Path, arm: Arm, seed: int = 0) -> None:
    """MuJoCo's inverse dynamics of a file and ours of an arm, on random states."""
    rng = np.random.default_rng(seed)
    q, speed, acceleration = rng.normal(size=(3, 6, len(arm)))
    smooth = replace(arm, joints=tuple(replace(joint, coulomb=(0.0, 0.0)) for joint in arm.joints))
    ours = torque_with_effects(smooth, q, speed, acceleration, np.zeros(6))
    theirs = mjcf_arms.torque(path, [joint.name for joint in arm.joints], q, speed, acceleration)
    np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-7 * np.abs(theirs).max())


def differing(arm: Arm, seed: int) -> Arm:
    """The arm with other numbers of every kind."""
    rng = np.random.default_rng(seed)

    def other(joint: Joint) -> Joint:
        points = rng.normal(scale=0.1, size=(20, 3))
        scatter = points.T @ points / 20
        tensor, mass = np.trace(scatter) * np.eye(3) - scatter, float(rng.uniform(0.1, 5))
        viscous, coulomb, rotor = (float(value) for value in rng.uniform(0, 2, 3))
        if joint.mass == 0.0:  # the first of two joints of one body
            return replace(joint, viscous=(viscous, viscous), rotor_inertia=rotor)
        return replace(
            joint,
            mass=mass,
            com=tuple(rng.normal(size=3).tolist()),
            inertia=tuple(float(mass * tensor[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))),
            viscous=(viscous, viscous),
            coulomb=(coulomb, coulomb),
            rotor_inertia=rotor,
            limits=(-1.5, 1.25),
        )

    return replace(arm, joints=tuple(other(joint) for joint in arm.joints))


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_random_arms_are_read_as_mujoco_reads_them_and_come_back_changed(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("mjcf")
    (folder / "arm.xml").write_text(mjcf_arms.mjcf(seed))
    arm = read_model(folder / "arm.xml")
    agree(folder / "arm.xml", arm, seed)
    changed = differing(arm, seed)
    update_mjcf(folder / "arm.xml", changed, folder / "new.xml")
    agree(folder / "new.xml", changed, seed)
    again = read_model(folder / "new.xml")
    for one, other in zip(again.joints, changed.joints):
        for name in ("mass", "com", "inertia", "viscous", "coulomb", "rotor_inertia", *["limits"] * bool(other.limits)):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-7, atol=1e-9, err_msg=name)


def test_a_realistic_file_with_includes_classes_and_fixed_bodies(original: Path, tmp_path: Path) -> None:
    arm = read_model(original)
    assert [joint.name for joint in arm.joints] == ["shoulder", "elbow"]
    assert arm.joints[0].mass == pytest.approx(2.9) and arm.joints[1].coulomb == (0.3, 0.3)
    assert [joint.rotor_inertia for joint in arm.joints] == [0.1, 0.02]
    assert [joint.limits for joint in arm.joints] == [(-2.8, 2.8), (-1.0, 2.0)]
    agree(original, arm)
    assert run(["model", str(original), "--out", str(tmp_path / "arm.toml")]) == 0
    agree(original, read_model(tmp_path / "arm.toml"))


def test_without_a_change_every_byte_stays(original: Path, tmp_path: Path) -> None:
    write_model(tmp_path / "arm.toml", read_model(original))
    assert run(["model", str(tmp_path / "arm.toml"), "--into", str(original), "--out", str(tmp_path / "new.xml")]) == 0
    assert (tmp_path / "new.xml").read_bytes() == original.read_bytes()
    assert {path.name for path in tmp_path.glob("*.xml")} == {"arm.xml", "forearm.xml", "new.xml"}


def test_only_the_numbers_of_a_changed_link_change(original: Path, tmp_path: Path) -> None:
    arm = read_model(original)
    shoulder = replace(arm.joints[0], mass=3.5, viscous=(0.9, 0.9))
    elbow = replace(arm.joints[1], mass=1.5, coulomb=(0.4, 0.4), rotor_inertia=0.03)
    changed = replace(arm, joints=(shoulder, elbow))
    write_model(tmp_path / "arm.toml", changed)
    assert run(["model", str(tmp_path / "arm.toml"), "--into", str(original), "--out", str(tmp_path / "new.xml")]) == 0
    before, after = (path.read_bytes().decode() for path in (original, tmp_path / "new.xml"))
    lost = [line[2:].strip() for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[:2] == "- "]
    assert [line.split()[0] for line in lost] == ["<inertial", "<joint", "<include"]
    assert '<joint name="shoulder" axis="0 0 1" damping="0.9"/>' in after and 'file="forearm_new.xml"' in after
    assert "\r\n" in after and "do not lose this" in after and (tmp_path / "forearm.xml").read_text() == FOREARM
    forearm = (tmp_path / "forearm_new.xml").read_text()
    assert 'mass="1.5"' in forearm and 'frictionloss="0.4"' in forearm and "<!-- the forearm -->" in forearm
    agree(tmp_path / "new.xml", changed)


def test_what_is_fixed_to_a_body_gives_way_where_the_rest_were_impossible(original: Path, tmp_path: Path) -> None:
    arm = read_model(original)
    changed = replace(arm, joints=(replace(arm.joints[0], mass=0.3), arm.joints[1]))
    update_mjcf(original, changed, tmp_path / "new.xml")
    agree(tmp_path / "new.xml", changed)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('<joint name="shoulder" axis="0 0 1"/>', '<joint name="shoulder" type="ball"/>', "expected hinge or slide"),
        ('<joint name="shoulder" axis="0 0 1"/>', "<freejoint/>", "is free"),
        ('axis="0 0 1"/>', 'axis="0 0 1" stiffness="3"/>', "has a spring"),
        ('childclass="arm"', 'childclass="leg"', "there is no default class 'leg'"),
        ('quat="1 0 0.2 0"', 'quat="0 0 0 0"', "needs a direction"),
        ('quat="1 0 0.2 0"', 'quat="1 0 0.2"', "expected 4 numbers"),
        ('<joint name="shoulder"', '<joint name="elbow"', "has two joints of the name 'elbow'"),
        ('mass = "2.5"', 'mass = "1e16"', r"mass: must be a finite number of at most 1e\+15"),
        ("forearm.xml", "elbow.xml", "no such file"),
        ("</mujoco>", "", "cannot be read"),
        ("<mujoco ", "<robot ", "cannot be read|not a MuJoCo model"),
        ('<light pos="0 0 3"/>', '<attach model="none"/>', "MuJoCo cannot compile it: .*prefix"),
        ('<body name="plate"', '<body name="finger"><joint/></body><body name="plate"', "branches into finger, lower"),
    ],
)
def test_what_is_not_read_is_said_in_one_line(old: str, new: str, complaint: str, original: Path) -> None:
    assert old in ARM
    original.write_text(ARM.replace(old, new))
    with pytest.raises(InputError, match=complaint) as caught:
        read_model(original)
    assert "\n" not in str(caught.value)


HAND = (
    '<body name="hand" pos="0 0 .4"><inertial mass=".3" pos="0 0 0" diaginertia="1e-3 1e-3 1e-3"/>'
    '<body name="left" pos="0 .04 .05"><inertial mass=".05" pos="0 0 .02" diaginertia="1e-5 1e-5 1e-5"/>{}</body>'
    '<body name="right" pos="0 -.04 .05"><inertial mass=".05" pos="0 0 .02" diaginertia="1e-5 1e-5 1e-5"/>{}</body>'
    "</body></body>"
)
SLIDES = ('<joint name="open" type="slide" axis="0 1 0"/>', '<joint name="close" type="slide" axis="0 -1 0"/>')
SCENE = '<body name="cube"><freejoint/><geom size=".1"/></body><body name="door"><joint/><geom size=".1"/></body>'


def test_bodies_without_end_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "deep.xml"
    path.write_text(f"<mujoco><worldbody>{'<body>' * 3000}{'</body>' * 3000}</worldbody></mujoco>")
    with pytest.raises(InputError, match="nested too deeply"):
        read_model(path)


@pytest.mark.parametrize("compiled", [False, True])
def test_of_a_scene_the_driven_arm_is_read_with_its_hand_at_rest(original: Path, compiled: bool) -> None:
    """As MuJoCo has it with the fingers fixed."""
    forearm = original.parent / "forearm.xml"
    forearm.write_text(FOREARM.replace("</body>", HAND.format(*SLIDES)))
    include = '<include file="forearm.xml"/>'
    framed = ARM.replace(include, f"<frame>{include}</frame>") if compiled else ARM
    original.write_text(framed.replace("</worldbody>", f"{SCENE}</worldbody>"))
    said = "open, close are not part of the chain to hand: counted as fixed where the file places them, with 0.1 kg"
    assert mjcf_gaps(original) == [said]
    with_hand = read_model(original)
    original.write_text(ARM)
    forearm.write_text(FOREARM.replace("</body>", HAND.format("", "")))
    agree(original, with_hand)


PLATE = '<body name="plate" pos="0.2 0 0"><inertial mass="0.4" pos="0 0 0" diaginertia="1e-3 1e-3 2e-3"/></body>'
TETRAHEDRON = '<asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset><worldbody>'
COMPILED = {
    "frame": {
        '<include file="forearm.xml"/>': '<frame pos=".02 0 .1" euler="0 .3 1"><include file="forearm.xml"/></frame>'
    },
    "replicate": {PLATE: f'<replicate count="3" offset="0 .1 0" euler="0 0 .5">{PLATE}</replicate>'},
    "attach": {
        '<include file="forearm.xml"/>': '<attach model="other" body="hand" prefix="my_"/>',
        "<worldbody>": '<asset><model name="other" file="other.xml"/></asset><worldbody>',
    },
    "compiler settotalmass": {'meshdir="assets"': 'settotalmass="3"'},
    "geom> is a mesh": {
        PLATE: '<body name="plate"><geom type="mesh" mesh="wedge" pos="0 .1 0"/></body>',
        "<worldbody>": TETRAHEDRON,
    },
}
OTHER = """<mujoco><worldbody><body name="hand" quat="1 .2 0 0"><joint name="roll" axis="1 0 0" damping=".3"
  armature=".04" range="-30 60"/><inertial mass=".7" pos=".1 0 0" diaginertia=".01 .02 .02"/></body>
  </worldbody></mujoco>"""


@pytest.mark.parametrize("what", COMPILED)
def test_what_only_the_compiler_of_mujoco_reads_is_read_by_it(
    what: str, original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = ARM
    for old, new in COMPILED[what].items():
        assert old in text
        text = text.replace(old, new)
    original.write_text(text)
    (tmp_path / "other.xml").write_text(OTHER)
    monkeypatch.chdir(tmp_path)
    arm = read_model(original)
    assert not list(tmp_path.glob("*.TXT"))  # MuJoCo's log of its warnings
    agree(original, arm)
    assert [joint.name for joint in arm.joints] == ["shoulder", "my_roll" if what == "attach" else "elbow"]
    assert arm.joints[0].limits == (-2.8, 2.8) and arm.joints[1].limits is not None
    with pytest.raises(InputError, match=f"has .*{what}.*nothing can be written"):
        update_mjcf(original, arm, tmp_path / "new.xml")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=rf"has .*{what}.*pip install 'armscope\[mujoco\]'"):
        read_model(original)


def test_a_tip_chooses_the_branch(original: Path, tmp_path: Path) -> None:
    original.write_text(ARM.replace('<body name="plate"', '<body name="finger"><joint/></body><body name="plate"'))
    out = tmp_path / "arm.toml"
    assert run(["model", str(original), "--tip", "lower", "--out", str(out)]) == 0
    assert [joint.name for joint in read_model(out).joints] == ["shoulder", "elbow"]


@settings(max_examples=60)
@given(place=st.integers(0, len(ARM) - 1), junk=st.binary(max_size=3))
def test_torn_files_are_refused_in_one_line_or_read(
    place: int, junk: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("mjcf") / "arm.xml"
    path.with_name("forearm.xml").write_text(FOREARM)
    data = ARM.encode()
    path.write_bytes(data)
    arm = read_model(path)
    path.write_bytes(data[:place] + junk + data[place + 1 :])
    try:
        update_mjcf(path, arm, path.with_name("new.xml"))
    except InputError as error:
        assert "\n" not in str(error)
