"""Causes whose sizes no body has are not named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, described
from diagnosis.cause import Cause, Estimate
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.possible import exists, impossible, is_physical
from diagnosis.verification.tenable import insignificant


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/models/puma560.toml")


def _cause(effect: str, joint: int, **values: tuple[float, float]) -> Cause:
    return Cause(
        effect=effect,
        joint=joint,
        parameters=[Estimate(name, value, std, "") for name, (value, std) in values.items()],
        confidence=0.98,
        before=1.0,
        after=0.1,
        group=((effect, joint),),
        evidence="",
        felt_at=joint,
        unit="A",
    )


def test_a_link_has_no_negative_mass(arm: Arm) -> None:
    lighter = EffectTerm("link_inertia", 3, {"mass": -100.0})
    assert not exists(arm, [lighter])
    with pytest.raises(InputError, match=r"effect\[1\]: link_inertia makes joint 3 impossible: mass"):
        described(replace(arm, effects=(lighter,)))
    assert impossible(arm, [_cause("link_inertia", 3, mass=(-100.0, 1.0))]) == 0


def test_a_law_without_a_linear_parameter_acts_once(arm: Arm) -> None:
    """The column of a spring or a gap is its whole change of the currents: a tenfold one is another law."""
    for c in candidates(arm):
        if c.unit_amplitude:
            assert [is_physical(c, np.array([size])) for size in (-1.0, 0.1, 1.0, 10.0)] == [False, False, True, False]


def test_a_parameter_beyond_what_a_model_file_holds_is_no_cause(arm: Arm) -> None:
    """Torques of 1e-5 N m without noise had a quintic coefficient of 6e19, in a file that no command read."""
    curved = EffectTerm("current_nonlinearity", 3, {"cubic": -2.9e10, "quintic": 6.4e19})
    assert not exists(arm, [curved])
    assert exists(arm, [EffectTerm("current_nonlinearity", 3, {"cubic": -0.01, "quintic": 1e-4})])


def test_a_moment_of_inertia_is_neither_negative_nor_larger_than_the_other_two(arm: Arm) -> None:
    good = _cause("link_inertia", 3, mass=(1.0, 0.1), ixx=(0.02, 0.001), iyy=(0.02, 0.001), izz=(0.02, 0.001))
    assert impossible(arm, [good]) is None
    assert impossible(arm, [good, _cause("link_inertia", 3, izz=(-3.0, 0.1))]) == 1
    assert impossible(arm, [_cause("link_inertia", 3, ixx=(5.0, 0.1))]) == 0
    assert impossible(arm, [_cause("rotor_inertia", 2, inertia=(-40.0, 0.1))]) == 0


def test_a_link_of_two_kilograms_has_no_negative_inertia_nor_less_than_its_mass_has_there(arm: Arm) -> None:
    assert impossible(arm, [_cause("link_inertia", 4, mass=(1.2, 0.1), izz=(-1.13, 0.3))]) == 0
    # a first moment of 2 kg m of a link of 0.8 kg, without the inertia that the mass has out there
    assert impossible(arm, [_cause("link_inertia", 4, mx=(2.0, 0.1))]) == 0
    body = _cause("link_inertia", 4, mass=(1.0, 0.1), mx=(0.1, 0.01), iyy=(0.03, 1e-3), izz=(0.03, 1e-3))
    assert impossible(arm, [body]) is None


def test_ten_values_within_two_deviations_of_zero_are_no_cause(arm: Arm) -> None:
    nothing = dict.fromkeys(("mass", "mx", "my", "mz", "ixx", "iyy", "izz", "ixy", "iyz", "ixz"), (1.8, 1.0))
    assert insignificant(arm, [_cause("link_inertia", 6, **nothing)]) == 0
    # one in ten is beyond two deviations by chance in every third case
    assert insignificant(arm, [_cause("link_inertia", 6, **{**nothing, "mass": (2.5, 1.0)})]) == 0
    assert insignificant(arm, [_cause("link_inertia", 6, **{**nothing, "mass": (3.5, 1.0)})]) is None
    assert insignificant(arm, [_cause("current_offset", 6, offset=(2.5, 1.0))]) is None


def test_what_the_data_says_nothing_of_is_not_impossible(arm: Arm) -> None:
    assert impossible(arm, [_cause("link_inertia", 3, izz=(-3.0, 2.0))]) is None


def test_causes_that_are_possible_one_by_one_may_be_impossible_together(arm: Arm) -> None:
    mass = arm.joints[2].mass
    half = _cause("link_inertia", 3, mass=(-0.6 * mass, 5.0))
    assert impossible(arm, [half]) is None
    assert impossible(arm, [half, half]) == 1


def test_a_base_turns_by_half_a_turn_at_most() -> None:
    """Of a planar arm, a roll has no first-order effect: rounding of it made one of -45800 rad."""
    assert CATALOGUE["base_tilt"].admits("roll", 0.3) and not CATALOGUE["base_tilt"].admits("roll", -45800.0)
    assert not CATALOGUE["joint_zero_offset"].admits("offset", 40.0)


def test_a_spring_whose_stiffness_may_be_any_is_no_name(root: Path) -> None:
    """It has no linear parameter: 1 / stiffness is as far from zero, in std, as the stiffness."""
    arm = armscope.read_model(root / "config/models/puma560.toml")
    assert insignificant(arm, [_cause("joint_compliance", 1, stiffness=(5200.0, 4900.0), damping=(1.0, 0.1))]) == 0
    assert insignificant(arm, [_cause("joint_compliance", 1, stiffness=(5200.0, 490.0), damping=(1.0, 2.0))]) is None
