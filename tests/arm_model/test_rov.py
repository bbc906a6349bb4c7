"""The arm on a small ROV: what docs/underwater.md says of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from arm_model.moving_base.numeric import mass_matrix_with_base
from examples.rov import figures, run, with_station
from experiment import read_experiment


def test_the_vehicle_has_the_published_allocation_and_nearly_floats(root: Path) -> None:
    arm = read_model(root / "config/models/rov_arm.toml")
    base = arm.floating
    assert base is not None
    assert np.linalg.matrix_rank(base.allocation) == 6
    # magnitudes of von Benzon et al. 2022, equation 14: forces 0.707 and 1, yaw 0.189, roll 0.218, pitch 0.12
    np.testing.assert_allclose(abs(base.allocation[:2, :4]), np.sqrt(0.5), rtol=1e-9)
    np.testing.assert_allclose(abs(base.allocation[5, :4]), (0.156 + 0.111) * np.sqrt(0.5), rtol=1e-9)
    np.testing.assert_allclose(abs(base.allocation[3:5, 4:]), [[0.218] * 4, [0.12] * 4], rtol=1e-9)
    assert mass_matrix_with_base(arm, np.zeros((1, 2)))[0, 2, 2] > base.mass + base.added[2, 2]
    water = sum(1000.0 * np.pi * 0.025**2 * 0.35 for _ in arm.joints)
    heavy = base.mass + sum(joint.mass for joint in arm.joints) - base.displaced_mass - water
    assert heavy == pytest.approx(0.126, abs=1e-3)


def test_feed_forward_takes_nine_tenths_of_the_throw(root: Path) -> None:
    arm = read_model(root / "config/models/rov_arm.toml")
    asked = read_experiment(root / "config/experiments/arms/rov_swing.toml")
    without, with_it = (figures(arm, run(with_station(arm, share), asked)) for share in (0.0, 1.0))
    assert 25.0 < without["base_largest_mm"] < 45.0
    assert 9.0 < without["turn_largest_deg"] < 16.0
    for name in ("base_largest_mm", "base_rms_mm", "turn_largest_deg", "tool_largest_mm", "tool_rms_mm"):
        assert with_it[name] < 0.12 * without[name], name


@pytest.mark.slow
def test_example_draws_and_reports(root: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "examples.rov", "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    printed = json.loads(done.stdout[: done.stdout.rindex("}") + 1])
    assert {path.name for path in tmp_path.iterdir()} == {"swing.png", "fast.png"}
    fast = {name: values["turn_largest_deg"] for name, values in printed["fast"].items()}
    assert fast["feed-forward 70 %"] < fast["feed-forward"] < fast["station keeping"] < fast["idle thrusters"]
