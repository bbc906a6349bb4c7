"""The Puma's experiment files: what the thesis asks for, within what the arm can do."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import forward
from arm_model.rigid_body.regressor import regressor
from daq.rig.preflight import check_motion
from daq.rig.rig_file import read_rig
from experiment import demand_of, read_experiment


@pytest.fixture(scope="module")
def generator(root: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", root / "config/experiments/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


def test_every_file_keeps_the_arms_limits_and_the_rigs(root: Path, arm: Arm, generator: ModuleType) -> None:
    rig = read_rig(root / "config/puma560_sim.toml", drivers=False)
    files = sorted((root / "config/experiments").glob("*.toml"))
    assert len(files) == 22 + 1 + 6 + 2
    for file in files:
        experiment = read_experiment(file)
        assert experiment.name == file.stem
        assert generator.keeps_limits(arm, experiment, 1.0), file.stem
        assert check_motion(rig, experiment) == [], file.stem


def test_the_files_are_what_the_generator_says(root: Path, arm: Arm, generator: ModuleType) -> None:
    folder = root / "config/experiments"
    plain = {**generator.single_joint_tests(), **generator.cube_tests(arm), **generator.slow_sweeps()}
    for name, experiment in plain.items():
        assert read_experiment(folder / f"{name}.toml") == experiment


def test_the_single_joint_tests_turn_one_joint_by_180_degrees_both_ways_at_two_speeds(generator: ModuleType) -> None:
    tests = generator.single_joint_tests().values()
    assert len(tests) == 12
    seen = set()
    for experiment in tests:
        demand = demand_of(experiment)
        q = demand(np.linspace(0, demand.duration, 500))
        turned = np.ptp(q, axis=0)
        (joint,) = np.flatnonzero(turned > 1e-6)
        assert turned[joint] == pytest.approx(np.pi, abs=1e-5)
        fraction = round(np.abs(np.diff(q[:, joint])).max() / (demand.duration / 499) / experiment.full_speed[joint], 2)
        seen.add((int(joint) + 1, fraction, bool(q[-1, joint] > q[0, joint])))
    assert seen == {(joint, speed, way) for joint in (1, 2, 3) for speed in (0.5, 1.0) for way in (True, False)}


def test_the_cube_points_lie_on_a_diagonal_plane_of_500_mm(root: Path, arm: Arm) -> None:
    experiment = read_experiment(root / "config/experiments/iso_cube.toml")
    poses = [experiment.start, *(segment.to for segment in experiment.segment if segment.type == "move")]
    frames = forward(arm, np.array(poses))
    points = frames[:, :3, 3]
    assert np.allclose(points[-1], points[0], atol=1e-5)
    centre, corners = points[0], points[1:5]
    assert np.allclose(np.abs(corners - centre), 0.8 * 0.25, atol=1e-5)  # a tenth of the diagonal inside, on every axis
    assert np.linalg.matrix_rank(corners - centre, tol=1e-3) == 2
    assert np.linalg.norm(corners[2] - corners[0]) == pytest.approx(0.8 * 0.5 * np.sqrt(3), abs=1e-5)
    assert np.allclose(frames[:, :3, 2], [0, 0, -1], atol=1e-5)


def test_the_excitations_differ_and_each_shows_every_base_parameter(
    root: Path, arm: Arm, generator: ModuleType
) -> None:
    random = np.random.default_rng(0)
    columns, _ = regressor(arm, *(random.uniform(-2, 2, (300, 6)) for _ in range(3)))
    stacked = columns.reshape(-1, columns.shape[-1])
    rank = np.linalg.matrix_rank(stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-12))
    q = []
    for name in ("excitation", "excitation_held_out"):
        motion = generator.motion(read_experiment(root / f"config/experiments/{name}.toml"), 0.05)
        columns, _ = regressor(arm, *motion)
        stacked = columns.reshape(-1, columns.shape[-1])
        singular = np.linalg.svd(stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-12), compute_uv=False)
        assert singular[rank - 1] / singular[0] > 1e-3
        q.append(motion[0])
    rows = min(map(len, q))
    assert np.abs(np.corrcoef(q[0][:rows, 1], q[1][:rows, 1])[0, 1]) < 0.8
