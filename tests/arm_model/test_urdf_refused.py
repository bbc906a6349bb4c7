"""URDF files that say what no arm has: refused in one line that names the link or joint, never read as another arm."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm_io import InputError
from arm_model import read_model
from arm_model.urdf import read_urdf
from tests.arm_model.test_urdf_tree import ARM, joint, link, written

MOVING = joint("base", "upper", "revolute")


def _with(change: tuple[str, str]) -> list[str]:
    """The arm with a change to its first moving joint."""
    assert change[0] in MOVING
    return [part.replace(*change) if part == MOVING else part for part in ARM]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), "<axis xyz='0 0 0'> has no direction; expected a vector other"),
        (('axis xyz="0 0 1"', 'axis xyz="0 0 1e-300"'), "axis: needs a direction"),
        (('lower="-3"', 'lower="4"'), "<limit lower='4' upper='3'>: lower must be below upper"),
        (("</joint>", '<dynamics damping="-1"/></joint>'), "<dynamics damping='-1'> must not be negative"),
        (("</joint>", '<dynamics friction="-0.5"/></joint>'), "<dynamics friction='-0.5'> must not be negative"),
    ],
)
def test_a_joint_that_cannot_be_is_named(tmp_path: Path, change: tuple[str, str], complaint: str) -> None:
    with pytest.raises(InputError, match=f"arm.urdf: joint 'base_upper': {complaint}"):
        read_urdf(written(tmp_path, _with(change)))


def test_equal_limits_are_none(tmp_path: Path) -> None:
    both = _with(('lower="-3" upper="3"', 'lower="0" upper="0"'))
    assert read_urdf(written(tmp_path, both)).joints[0].limits is None


def test_two_links_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has two links of the name 'upper'"):
        read_urdf(written(tmp_path, [*ARM, link("upper")]))


def test_what_no_model_file_may_say_is_refused(tmp_path: Path) -> None:
    """Two joints of one name, and a mass of 1e300 kg: ``armscope model`` wrote files that it refused to read."""
    with pytest.raises(InputError, match="has two joints of the name 'base_upper'"):
        read_urdf(written(tmp_path, [part.replace('"upper_fore"', '"base_upper"') for part in ARM]))
    with pytest.raises(InputError, match=r"value: must be a finite number of at most 1e\+15"):
        read_urdf(written(tmp_path, [FINGER.format("1e-7").replace("0.004", "1e300"), joint("hand", "finger"), *ARM]))


FINGER = (
    '<link name="finger"><inertial><mass value="0.004"/>'
    '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="{}"/></inertial></link>'
)


def test_a_small_link_whose_inertia_a_file_has_rounded_is_read(tmp_path: Path) -> None:
    """Of 5e-7, 5e-7 and 1e-6 kg m2, six digits leave 0, 0 and 1e-6, which no body has; fixed to the hand, it may be."""
    with_finger = [*ARM, FINGER.format("1E-06"), joint("hand", "finger", xyz="0.03 0 0.1")]
    plain = read_urdf(written(tmp_path, ARM), tip="tool0").joints[-1]
    assert read_urdf(written(tmp_path, with_finger), tip="tool0").joints[-1].mass == pytest.approx(plain.mass + 0.004)


@pytest.mark.parametrize("izz", ["1.000E-06", "0.0000020", "0.15"])
def test_what_rounding_does_not_explain_is_refused(tmp_path: Path, izz: str) -> None:
    with pytest.raises(InputError, match="link 'finger': inertia breaks the triangle inequality"):
        read_urdf(written(tmp_path, [*ARM, FINGER.format(izz), joint("hand", "finger")]), tip="tool0")


@pytest.mark.parametrize(
    "change",
    [
        ('xyz="0.1 0.2 0.3"', 'xyz="0.1 1e160 0.3"'),
        ('axis xyz="0 0 1"', 'axis xyz="0 0 -1e300"'),
        ("0.4 0.5", "0.4 1e9"),
    ],
)
def test_lengths_that_no_arm_has_are_refused(tmp_path: Path, change: tuple[str, str]) -> None:
    """Their squares are no numbers."""
    with pytest.raises(InputError, match="is beyond 1e\\+06; lengths are in m, angles in rad"):
        read_urdf(written(tmp_path, _with(change)))


def test_a_xacro_file_is_to_be_expanded_first(tmp_path: Path) -> None:
    """It was 'not valid TOML', and an expression 'expected 1 numbers'."""
    (tmp_path / "arm.urdf.xacro").write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"/>')
    with pytest.raises(InputError, match="is a xacro file; expand it first: xacro FILE > ARM.urdf"):
        read_model(tmp_path / "arm.urdf.xacro")
    expression = _with(('lower="-3"', 'lower="${-pi}"'))
    with pytest.raises(InputError, match="is an expression of xacro; expand the file first"):
        read_urdf(written(tmp_path, expression))
