"""The water's coefficients are found from a recording: they are columns of the regressor like any other parameter."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from identification.regression.physical_consistency import BaseFit, Prior, consistent_parameters

CONTROLLER = """
[controller]
kind = "bandwidth"
natural_frequency = [10.0, 10.0]
inertia_pose = [0.0, 0.0]
"""
EXPERIMENT = """
name = "back and forth"
start = [0, 0]
full_speed = [1.5, 1.5]
full_acceleration = [6, 6]
rate = 500
"""
POINTS = [(0.8, -0.6), (-0.5, 0.9), (0.2, 0.5), (-0.4, -1.0), (0.0, 0.0)]


def test_drag_and_added_mass_of_the_underwater_arm(root: Path, tmp_path: Path) -> None:
    wet = (root / "config/models/underwater.toml").read_text() + CONTROLLER
    dry = wet.replace("drag_coefficient = 1.0", "drag_coefficient = 0.0")
    dry = dry.replace("added_mass_coefficient = 2.0", "added_mass_coefficient = 0.0")
    moves = "".join(f'[[segment]]\ntype = "move"\nto = [{a}, {b}]\n' for a, b in POINTS)
    for name, text in (("wet.toml", wet), ("dry.toml", dry), ("move.toml", EXPERIMENT + moves)):
        (tmp_path / name).write_text(text)
    recording, out = str(tmp_path / "run.mcap"), tmp_path / "out"
    arguments = ["--experiment", str(tmp_path / "move.toml"), "--out", recording]
    assert run(["simulate", "--model", str(tmp_path / "wet.toml"), *arguments]) == 0
    assert run(["identify", recording, "--model", str(tmp_path / "dry.toml"), "--out", str(out)]) == 0
    found = {entry["name"]: entry for entry in json.loads((out / "identification.json").read_text())["parameters"]}
    first = found["link1.drag_coefficient"]
    assert first["std"] < 0.02 and abs(first["value"] - 1.0) < 3 * first["std"]
    assert found["link2.drag_coefficient"]["value"] == pytest.approx(1.0, rel=1e-3)
    # of link 1, which only turns about its own end, the added mass cannot be distinguished from its inertia
    assert found["link2.added_mass_coefficient"]["value"] == pytest.approx(2.0, rel=0.01)
    assert not found["link1.added_mass_coefficient"]["identifiable"]
    assert found["link2.added_mass_coefficient"]["unit"] == "1"


@pytest.mark.parametrize("name", ["joint1.drag", "link1.drag_coefficient", "joint1.link_viscous"])
def test_what_a_model_file_refuses_below_zero_is_not_estimated_there(name: str) -> None:
    """Data that fit best at -7 +- 0.1: the nearest number that a model may have is 0."""
    found = consistent_parameters(
        BaseFit(np.eye(1), np.array([-7.0]), np.array([[100.0]])), Prior([name], np.array([0.5]))
    )
    assert 0.0 <= found[0] < 0.01
