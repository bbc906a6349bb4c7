"""Friction that grew by half in both directions, where the model has their difference as a constant torque."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import armscope
from diagnosis.measurements.currents.columns import own_skews
from tests.diagnosis.numpy_arm import GEAR, NumpyArm, model, straight

EQUAL = (straight(9.0, 8.0),) * 2
OFFSET = 0.75 / GEAR[1]
"""N m at the motor: of 6 N m forwards and 4.5 N m backwards, as ``identify`` has them without --friction asymmetric."""


def test_it_is_coulomb_friction_and_no_asymmetry(tmp_path: Path) -> None:
    grown = NumpyArm((EQUAL, (straight(9.0, 5.0), straight(6.75, 5.0))))
    fit, held_out = (grown.record(tmp_path / f"{seed}.mcap", seed, seconds=12.0) for seed in (5, 6))
    arm = model([(9.0, 9.0), (5.25, 5.25)], [8.0, 5.0])
    arm = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], offset=OFFSET)))
    (cause,) = armscope.diagnose(fit, arm, held_out=held_out).causes
    assert (cause.effect, cause.joint) == ("coulomb_friction", 2)
    coulomb = next(p for p in cause.parameters if p.name == "coulomb")
    assert coulomb.of_own == pytest.approx(0.5, abs=0.03)


def test_a_constant_torque_larger_than_friction_is_no_difference_of_directions() -> None:
    arm = model([(9.0, 9.0), (6.0, 4.5)], [8.0, 5.0])
    assert own_skews(arm.joints[0]) == []
    assert own_skews(arm.joints[1]) == pytest.approx([1.5 / 10.5])
    assert own_skews(replace(arm.joints[0], offset=20.0 / GEAR[0])) == []
    assert own_skews(replace(arm.joints[1], offset=1.0 / GEAR[1])) == pytest.approx([1.5 / 10.5, 3.5 / 10.5])
