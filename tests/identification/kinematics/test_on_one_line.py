"""Two neighbouring joints on one line: D-H parameters are singular there, and a calibration says so."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from arm_model import Arm, Joint
from identification.kinematics.estimation.judgement import _on_one_line
from identification.kinematics.models.parameters import Trust


def _said(*joints: dict[str, Any], convention: str = "standard") -> list[str]:
    arm = Arm("arm", tuple(Joint(convention=convention, **joint) for joint in joints))  # type: ignore[arg-type]
    return list(_on_one_line(cast(Any, SimpleNamespace(arm=arm, settings=SimpleNamespace(trust=Trust())))))


@pytest.mark.parametrize("apart", [0.0, 0.009, -0.009])
def test_lines_nearer_than_a_length_is_known_are_named(apart: float) -> None:
    (said,) = _said({"alpha": 1.5, "a": 0.1}, {"a": apart, "d": 0.3}, {"alpha": -1.5, "a": 0.2}, {})
    assert said.startswith(f"joints 2 and 3 turn about lines {1e3 * abs(apart):.2g} mm apart: ")


def test_lines_apart_lines_that_cross_and_sliding_joints_are_not() -> None:
    sliding = {"type": "prismatic", "d": 0.1}
    assert _said({"a": 0.1}, {"alpha": 1.57}, {"a": 0.3}, {}) == []
    assert _said({"alpha": 0.0, "a": 0.3}, sliding, {}) == []
    assert _said({"a": 0.3}, {}, sliding) == []


def test_in_the_modified_convention_the_length_is_that_of_the_second_joint() -> None:
    (said,) = _said({}, {"alpha": 1.57}, {"a": 0.001}, {"a": 0.3, "alpha": 1.57}, convention="modified")
    assert said.startswith("joints 2 and 3 turn about lines 1 mm apart: ")
