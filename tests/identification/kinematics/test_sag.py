"""Sag from poses and gravity alone, with and without masses, on arms simulated by code of their own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
import benchmarks.foreign_calibration as foreign
from arm_model.description import Arm
from arm_model.rigid_body.gravity_level import gravity_levels
from arm_model.rigid_body.numeric import rigid_torque
from arm_model.tracking import target_at
from armscope.cli import run
from tests.arm_model.random_arms import random_arm


@pytest.mark.parametrize("seed", range(6))
def test_levels_and_first_moments_make_up_the_gravity_torque(seed: int) -> None:
    """Of one link with all its mass at a point across its joint's axis, for any convention and kind of joint."""
    generator = np.random.default_rng(seed)
    arm = random_arm(generator)
    bare = [replace(j, mass=0.0, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6, rotor_inertia=0.0) for j in arm.joints]
    arm = replace(arm, effects=(), coupling=(), gravity=(1.0, -2.0, -9.0))
    q = generator.uniform(-2, 2, (7, len(arm)))
    link = int(generator.integers(1, len(arm) + 1))
    plain = torque_of(arm, bare, link, (0.0, 0.0, 0.0), q)
    found = gravity_levels(arm, q, link) * np.linalg.norm(arm.gravity)
    columns = np.stack([torque_of(arm, bare, link, tuple(e), q) - plain for e in np.eye(3)], axis=2)
    revolute = [j.revolute for j in arm.joints]
    # both columns are combinations of the three moments along the link's axes, the same ones in every pose
    flat, ours = columns[:, revolute].reshape(-1, 3), found[:, revolute].reshape(-1, 2)
    weights = np.linalg.lstsq(flat, ours, rcond=None)[0]
    np.testing.assert_allclose(flat @ weights, ours, atol=1e-9)
    assert not found[:, [not r for r in revolute]].any()
    assert not found[:, link:].any()


def torque_of(arm: Arm, bare: list, link: int, com: tuple[float, ...], q: np.ndarray) -> np.ndarray:
    joints = list(bare)
    joints[link - 1] = replace(bare[link - 1], mass=1.0, com=com)
    still = np.zeros_like(q)
    return rigid_torque(replace(arm, joints=tuple(joints)), q, still, still)


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> tuple[foreign.TrueArm, Path, tuple, tuple]:
    """A KR 6 with compliant joints: 60 measured poses and 200 exact ones."""
    arm = foreign.TrueArm("KR 6 R900", 0, 4e-5)
    arm.compliance *= 5.0
    (q, points), unseen = arm.poses(60), arm.poses(200, 0.0)
    return arm, tmp_path_factory.mktemp("poses"), (q, arm.measured(points)), unseen


FOUND: dict[tuple[Path, bool, tuple[int, ...]], armscope.Calibration] = {}
"""What several tests look at is calibrated once per folder of the module."""


def held_out(folder: Path, masses: bool, fitted: tuple, unseen: tuple, reflectors: list[int]) -> armscope.Calibration:
    key = folder, masses, tuple(reflectors)
    if key not in FOUND:
        FOUND[key] = _calibrated(folder, masses, fitted, unseen, reflectors)
    return FOUND[key]


def _calibrated(
    folder: Path, masses: bool, fitted: tuple, unseen: tuple, reflectors: list[int]
) -> armscope.Calibration:
    (folder / "arm.urdf").write_text(foreign.urdf("KR 6 R900", masses))
    (q, xyz), (u, truth) = fitted, unseen
    return foreign.calibrated(folder / "arm.urdf", folder, q, xyz[:, reflectors], (u, truth[:, reflectors]))


def test_compliance_follows_from_poses_and_the_masses_of_the_model(poses) -> None:
    """The masses of the model are off by up to 5 %, and so may be the compliance; the deviation covers the rest."""
    arm, folder, fitted, unseen = poses
    found = held_out(folder, True, fitted, unseen, [0]).to_json()
    sag = {e["joint"]: e["parameters"]["compliance"] for e in found["effects"] if e["effect"] == "link_sag"}
    assert {2, 3} <= set(sag)
    for joint in (2, 3):
        true = arm.compliance[joint - 1]
        assert abs(sag[joint]["value"] - true) < 4.0 * np.hypot(sag[joint]["std"], 0.05 * true)
    assert found["position_rms"]["held_out"]["after"] < arm.noise


def test_without_masses_the_shape_of_the_gravity_torque_is_identified(poses) -> None:
    """Far better than any rigid arm; the effect stands in the model file and is applied by prediction from it."""
    _, folder, fitted, unseen = poses
    found = held_out(folder, False, fitted, unseen, [0])
    table = found.to_json()
    assert {e["effect"] for e in table["effects"]} == {"gravity_sag"}
    assert any("encoder_eccentricity of joint 2" in e["indistinguishable"] for e in table["effects"])
    rigid = foreign.by_screws(foreign.fit_screws("KR 6 R900", fitted[0], fitted[1][:, 0]), unseen[0]) - unseen[1][:, 0]
    reached = table["position_rms"]["held_out"]["after"]
    assert reached < 0.4 * float(np.sqrt(np.mean(rigid**2)))
    found.write(folder / "out")
    model = armscope.read_model(folder / "out/model.toml")
    at = target_at(model, unseen[0], np.array(table["tool"])[:3, 3])
    pose = np.linalg.inv(np.array(table["tracker_frame"]["base_from_tracker"]))
    residual = at @ pose[:3, :3].T + pose[:3, 3] - unseen[1][:, 0]
    assert float(np.sqrt(np.mean(residual**2))) == pytest.approx(reached, rel=1e-3)


@pytest.mark.slow
def test_better_than_a_product_of_exponentials_and_three_reflectors_better_still(poses) -> None:
    _, folder, fitted, unseen = poses
    theirs = foreign.by_screws(foreign.fit_screws("KR 6 R900", fitted[0], fitted[1][:, 0]), unseen[0]) - unseen[1][:, 0]
    alone = [held_out(folder, True, fitted, unseen, [k]).position_rms["held_out"]["after"] for k in range(3)]
    assert alone[0] <= float(np.sqrt(np.mean(theirs**2)))
    three = held_out(folder, True, fitted, unseen, [0, 1, 2]).position_rms["held_out"]["after"]
    assert three <= 0.7 * float(np.sqrt(np.mean(np.square(alone))))


def test_why_there_is_no_circle_point_analysis_is_said(poses, tmp_path: Path) -> None:
    _, folder, fitted, unseen = poses
    found = held_out(folder, True, fitted, unseen, [0]).to_json()
    assert "no joint was swept alone" in found["without_circle_points"]
    assert "each joint must be moved alone" in found["without_circle_points"]


def test_sweeps_in_a_table_of_poses_give_circles(tmp_path: Path) -> None:
    """Twelve poses per joint, one joint at a time."""
    arm = foreign.TrueArm("IRB 120", 1, 4e-5)
    middle = (arm.low + arm.high) / 2 + 0.3
    q = np.tile(middle, (6 * 12, 1))
    for j in range(6):
        q[12 * j : 12 * j + 12, j] = np.linspace(arm.low[j], arm.high[j], 12)
    xyz = arm.measured(np.array([arm.points(row) for row in q]))[:, [0]]
    (tmp_path / "arm.urdf").write_text(foreign.urdf("IRB 120"))
    table = foreign.table(tmp_path / "sweeps.csv", q, xyz)
    out = tmp_path / "out"
    arguments = ["calibrate", str(table), "--model", str(tmp_path / "arm.urdf"), "--out", str(out)]
    place = ",".join(f"{v:.6f}" for v in arm.reflectors[0])
    assert run([*arguments, "--target", place]) == 0
    found = json.loads((out / "kinematics.json").read_text())
    assert {c["joint"] for c in found["circles"]} == {1, 2, 3, 4, 5, 6}
    assert found["without_circle_points"] is None
    assert found["circle_point"]["fit"]["rms"] < 3e-3
    unknown = armscope.calibrate(table, tmp_path / "arm.urdf", geometry_only=True).to_json()
    assert unknown["circle_point"] is None
    assert "the position of the target is not known" in unknown["without_circle_points"]
