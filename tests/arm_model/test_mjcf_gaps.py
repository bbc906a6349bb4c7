"""What acts in a MuJoCo model and is no number of an arm: honoured as MuJoCo does, said, or refused; never passed over.

Each as the file has it, and within a <frame>, which MuJoCo's own compiler reads.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model import read_model
from arm_model.mjcf import mjcf_gaps
from arm_model.system.inverse import torque_with_effects
from armscope.cli import run

mjcf_arms = pytest.importorskip("tests.arm_model.mjcf_arms", reason="needs mujoco", exc_type=ImportError)

ARM = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"><flag contact="disable"/></option>
<default><joint damping="1"/><equality active="true"/></default>
<worldbody><body name="cart"><freejoint/><geom size=".1"/></body>
  <body name="upper"><joint name="shoulder" axis="0 1 0" damping="1"/>
  <inertial mass="2" pos=".3 0 0" diaginertia=".1 .1 .1"/><site name="mark"/>
  <body name="lower" pos=".5 0 0"><joint name="elbow" axis="0 1 0"/>
    <inertial mass="1" pos=".2 0 0" diaginertia=".05 .05 .05"/><site name="tip" pos=".4 0 0"/>
    <body name="plate" pos=".4 0 0"><inertial mass=".1" pos="0 0 0" diaginertia="1e-3 1e-3 1e-3"/></body>
  </body></body></worldbody>
<equality/><actuator><motor joint="shoulder"/></actuator></mujoco>
"""
LOWER, ENDS = '<body name="lower"', "</body></body></worldbody>"


def written(folder: Path, *changes: tuple[str, str], compiled: bool) -> Path:
    text = ARM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    if compiled:
        text = text.replace(LOWER, f"<frame>{LOWER}").replace(
            "</body></body></worldbody>", "</body></frame></body></worldbody>"
        )
    (folder / "arm.xml").write_text(text)
    return folder / "arm.xml"


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("flag", ["contact", "gravity"])
def test_a_model_without_gravity_has_none(flag: str, compiled: bool, tmp_path: Path) -> None:
    path = written(tmp_path, ('contact="disable"', f'{flag}="disable"'), compiled=compiled)
    arm = read_model(path)
    assert mjcf_gaps(path) == []
    q, speed, acceleration = np.random.default_rng(4).normal(size=(3, 6, 2))
    ours = torque_with_effects(arm, q, speed, acceleration, np.zeros(6))
    theirs = mjcf_arms.torque(path, ["shoulder", "elbow"], q, speed, acceleration)
    np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-7)
    assert (np.abs(torque_with_effects(arm, q, 0 * q, 0 * q, np.zeros(6))).max() < 1e-12) == (flag == "gravity")


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ((LOWER, f'{LOWER} gravcomp="0.5"'), "gravcomp of lower is not read: here the motors carry the whole weight"),
        (("<equality/>", '<equality><joint joint1="elbow" joint2="shoulder"/></equality>'), "elbow follows shoulder"),
        (("<equality/>", '<equality><joint joint1="elbow"/></equality>'), "elbow is held in its place by <equality>"),
        (
            ("<equality/>", '<equality><weld body1="cart" body2="lower"/></equality>'),
            "<weld> holds cart to lower: not read",
        ),
        (("<equality/>", '<equality><connect body1="lower" anchor="0 0 0"/></equality>'), "<connect> holds lower"),
        (('contact="disable"', 'frictionloss="disable"'), "frictionloss is disabled by <flag>: frictionloss of the"),
        (("<equality/>", '<equality><joint joint1="elbow" joint2="shoulder" active="false"/></equality>'), ""),
        (("<equality/>", '<equality><weld body1="plate" body2="lower"/></equality>'), ""),
    ],
)
def test_what_acts_and_is_not_read_is_said(
    change: tuple[str, str], said: str, compiled: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, change, compiled=compiled)
    assert run(["model", str(path)]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note: ")]
    assert len(notes) == bool(said) and all(said in note for note in notes)


def test_a_weld_between_sites_is_said_by_their_bodies(tmp_path: Path) -> None:
    weld = ("<equality/>", '<equality><weld site1="mark" site2="tip"/></equality>')
    assert "<weld> holds mark to tip" in mjcf_gaps(written(tmp_path, weld, compiled=False))[0]
    assert "<weld> holds upper to lower" in mjcf_gaps(written(tmp_path, weld, compiled=True))[0]


def test_a_default_class_switches_constraints_off(tmp_path: Path) -> None:
    off = ('active="true"', 'active="false"')
    joint = ("<equality/>", '<equality><joint joint1="elbow" joint2="shoulder"/></equality>')
    for compiled in (False, True):
        assert mjcf_gaps(written(tmp_path, off, joint, compiled=compiled)) == []


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    ("new", "complaint"),
    [
        ('damping="1 0.5"', "joint 'shoulder' has damping='1.*0.5.*': only the first number"),
        ('stiffness="0 2"', "joint 'shoulder' has a spring"),
    ],
)
def test_polynomials_are_refused_on_both_ways(new: str, complaint: str, compiled: bool, tmp_path: Path) -> None:
    import mujoco

    if not hasattr(mujoco.MjModel, "dof_dampingpoly"):
        pytest.skip("MuJoCo before 4 has no polynomials")
    path = written(tmp_path, ('axis="0 1 0" damping="1"', f'axis="0 1 0" {new}'), compiled=compiled)
    with pytest.raises(InputError, match=complaint):
        read_model(path)


def test_a_polynomial_of_one_term_is_a_number(tmp_path: Path) -> None:
    text = ('axis="0 1 0" damping="1"', 'axis="0 1 0" damping="1.5 0"')
    for compiled in (False, True):
        assert read_model(written(tmp_path, text, compiled=compiled)).joints[0].viscous == (1.5, 1.5)
