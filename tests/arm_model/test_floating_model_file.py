"""Model files of floating bases: read back as they were written, and refused in one line where they are wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arm_io import InputError
from arm_model.model_file import arm_of, model_table, on_fixed_base, read_model, write_model
from arm_model.tables import StationKeeping
from tests.arm_model.floating_arms import floating_arm

THRUSTER = {"position": [0.0, 0.1, 0.0], "direction": [1.0, 0.0, 0.0], "limits": [-40.0, 40.0]}


def table(**base: Any) -> dict[str, Any]:
    joint = {"type": "revolute", "mass": 1.0, "com": [0.0, 0.0, 0.0], "inertia": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]}
    vehicle = {"kind": "floating", "mass": 10.0, "inertia": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0], "thruster": [THRUSTER]}
    return {"name": "rov", "units": "SI", "joint": [joint], "base": vehicle | base}


@pytest.mark.parametrize("water", [False, True])
def test_a_written_model_reads_back_equal(water: bool, tmp_path: Path) -> None:
    arm = floating_arm(1, water=water)
    assert arm.floating is not None
    station = StationKeeping(natural_frequency=(1.0,) * 6, integral_rate=0.2)
    arm = replace(arm, floating=replace(arm.floating, controller=station))
    write_model(tmp_path / "rov.toml", arm)
    assert read_model(tmp_path / "rov.toml") == arm
    assert "mount" in model_table(arm)["base"]


def test_six_numbers_are_a_diagonal() -> None:
    arm = arm_of(table(added_mass=[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]), "rov.toml")
    assert arm.floating is not None
    assert arm.floating.added.diagonal().tolist() == [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    assert arm.floating.added.sum() == pytest.approx(6.6)


SKEWED = [[float(i == k) + (i == 0 and k == 1) for k in range(6)] for i in range(6)]


@pytest.mark.parametrize(
    ("entries", "complaint"),
    [
        ({"kind": "buoy"}, "base.kind: must be"),
        ({"mass": -1.0}, "base.mass: input should be greater than 0"),
        ({"inertia": [0.1, 0.1, 5.0, 0.0, 0.0, 0.0]}, "base: inertia breaks the triangle inequality"),
        ({"added_mass": SKEWED}, "added_mass: must be symmetric"),
        ({"added_mass": [-1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}, "added_mass: has a negative eigenvalue"),
        ({"quadratic_drag": [1.0, 1.0, 1.0, 1.0, 1.0, -1.0]}, "base.quadratic_drag[6]"),
        ({"thruster": [THRUSTER | {"direction": [0.0, 0.0, 0.0]}]}, "direction: must not be zero"),
        ({"thruster": [THRUSTER | {"limits": [1.0, 1.0]}]}, "limits: the lower is not below the upper"),
        ({"thruster": [], "controller": {"natural_frequency": [1.0] * 6}}, "controller: needs at least one"),
        ({"controller": {"natural_frequency": [1.0] * 6, "feedforward": 1.0}}, "feedforward: needs a [controller]"),
        ({"mount": [[1.0]]}, "base"),
        ({"depth": 3.0}, "base.depth: unknown entry"),
    ],
)
def test_a_wrong_base_is_refused_in_one_line(entries: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as refused:
        arm_of(table(**entries), "rov.toml")
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_arm_that_floats_is_refused_where_a_fixed_base_is_needed() -> None:
    with pytest.raises(InputError, match="floating base, and 'armscope identify' takes arms on a fixed one"):
        on_fixed_base(arm_of(table(), "rov.toml"), "rov.toml", "'armscope identify'")
