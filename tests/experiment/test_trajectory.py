"""Motions for other controllers: their points, read by other parsers, are the demand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from arm_io import InputError
from experiment import Demand, demand_of, experiment_of, write_trajectory

NAMES = ["base: 1", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3"]


@pytest.fixture
def demand() -> Demand:
    rng = np.random.default_rng(4)
    coefficients = {name: (0.1 * rng.normal(size=(6, 3))).tolist() for name in ("sine", "cosine")}
    table = {
        "name": "series",
        "start": [0.1, -1.0, 1.0, 0.0, 0.5, 0.0],
        "full_speed": [1.0] * 6,
        "full_acceleration": [2.0] * 6,
        "segment": [
            {"type": "hold", "duration": 0.5},
            {"type": "fourier", "duration": 5.0, "fundamental": 0.2, **coefficients},
            {"type": "move", "to": [0.0] * 6, "speed": 0.5},
        ],
    }
    return demand_of(experiment_of(table, "test"))


@pytest.mark.parametrize("ending", ["yaml", "json"])
def test_a_joint_trajectory_interpolated_as_ros_does_is_the_demand(ending: str, demand: Demand, tmp_path: Path) -> None:
    path = tmp_path / f"motion.{ending}"
    count = write_trajectory(path, demand, NAMES, 100.0)
    if ending == "yaml":
        found = pytest.importorskip("ruamel.yaml").YAML(typ="safe").load(path.read_text())
    else:
        found = json.loads(path.read_text())
    assert found["joint_names"] == NAMES and len(found["points"]) == count
    t = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in found["points"]])
    q, v = (np.array([p[key] for p in found["points"]]) for key in ("positions", "velocities"))
    assert np.all(np.diff(t) > 0) and abs(t[-1] - demand.duration) < 1e-9 and not v[[0, -1]].any()
    between = np.random.default_rng(0).uniform(0, demand.duration, 500)
    np.testing.assert_allclose(CubicHermiteSpline(t, q, v)(between), demand(between), atol=2e-5)


def test_csv_and_urscript_have_the_points(demand: Demand, tmp_path: Path) -> None:
    write_trajectory(tmp_path / "motion.csv", demand, NAMES, 125.0)
    table = np.loadtxt(tmp_path / "motion.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 1:], demand(table[:, 0]))
    write_trajectory(tmp_path / "motion.script", demand, NAMES, 125.0)
    text = (tmp_path / "motion.script").read_text()
    servo = [json.loads(found) for found in re.findall(r"servoj\((\[.*?\]), t=0.008,", text)]
    np.testing.assert_allclose(servo, table[:, 1:], atol=1e-9)
    assert text.startswith("def ") and text.endswith("end\narmscope_motion()\n")


def test_what_cannot_be_written(demand: Demand, tmp_path: Path) -> None:
    for name, joints, rate, complaint in [
        ("a.txt", NAMES, 100.0, r"must end in \.yaml"),
        ("a.script", NAMES[:3], 125.0, "URScript is for arms of 6 joints, this one has 3"),
        ("none/a.csv", NAMES, 100.0, "no folder"),
        ("a.csv", NAMES, 1e9, "at most 2000000"),
    ]:
        with pytest.raises(InputError, match=complaint):
            write_trajectory(tmp_path / name, demand, joints, rate)
    assert not list(tmp_path.iterdir())
