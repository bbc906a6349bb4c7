"""Units of the catalogue at joints that slide, and at drives that are commanded by something else than amperes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arm_model import Joint
from arm_model.effects import CATALOGUE
from diagnosis.units import unit_at

EVERY = sorted({(p.unit, p.name) for effect in CATALOGUE.values() if effect.per_joint for p in effect.parameters})


@pytest.mark.parametrize(("unit", "name"), EVERY)
def test_a_joint_that_slides_has_no_radians_and_no_torques(unit: str, name: str) -> None:
    at = unit_at(Joint(type="prismatic"), unit, name)
    assert at == unit if name == "phase" else not ({"rad", "rad3", "rad5", "(rad", "kg m2"} & {*at.split("/"), at})
    if name != "phase" and unit not in ("kg m", "kg m2"):
        assert not at.startswith("N m") and "(N m)" not in at


@pytest.mark.parametrize("unit", ["A", "1/A2", "1/A4"])
def test_a_drive_commanded_in_newton_metres_has_no_amperes(unit: str) -> None:
    joint = replace(Joint(), current_unit="N m")
    assert unit_at(joint, unit) == unit.replace("A", "N m" if unit == "A" else "(N m)")
