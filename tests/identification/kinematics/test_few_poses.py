"""Few poses, orientations of any noise, and targets given in mm, on an arm of foreign code."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from foreign_arm import ForeignArm, parallelogram
from test_reflectors import ANGLES, PLACES, calibrate, estimated, saved, seen, turned


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("count", [12, 20])
def test_orientations_count_by_their_noise_also_in_few_poses(tmp_path: Path, count: int, noise: float) -> None:
    """noise rad: from that of an arm's own angles to that of a camera. No pose is wrong."""
    for seed in (61, 62):
        arm, generator = ForeignArm(seed=seed), np.random.default_rng(seed)
        q = arm.reported(count, generator)
        xyz, turns = seen(arm, q, "A", generator), turned(arm, q, generator, noise)
        found = estimated(
            tmp_path, saved(tmp_path / "p.csv", f"{ANGLES},x,y,z,qx,qy,qz,qw", q, xyz, turns.as_quat()), target=None
        )
        assert not found.failures
        assert found.to_json()["left_out"] == []


@pytest.mark.parametrize("seed", [63, 64, 65, 66])
def test_eleven_poses_without_a_wrong_one_contradict_no_model(tmp_path: Path, seed: int) -> None:
    """33 coordinates for 27 parameters: a pose predicted without its tenth may be far off, and it is known how far."""
    arm, generator = ForeignArm(seed=seed), np.random.default_rng(seed)
    q = arm.reported(11, generator)
    found = estimated(tmp_path, saved(tmp_path / "p.csv", f"{ANGLES},x,y,z", q, seen(arm, q, "A", generator)))
    assert not found.failures


def test_a_wrong_pose_among_few_is_found(tmp_path: Path) -> None:
    arm, generator = ForeignArm(seed=67), np.random.default_rng(67)
    q = arm.reported(25, generator)
    xyz = seen(arm, q, "A", generator)
    xyz[7] += 0.02
    found = estimated(tmp_path, saved(tmp_path / "p.csv", f"{ANGLES},x,y,z", q, xyz))
    assert [row for one in found.to_json()["left_out"] if one["part"] == "fit" for row in one["rows"]] == [8]


def test_a_target_in_mm_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, generator = ForeignArm(seed=68), np.random.default_rng(68)
    q = arm.reported(20, generator)
    table = saved(tmp_path / "p.csv", f"{ANGLES},x,y,z", q, seen(arm, q, "A", generator))
    place = ",".join(f"{1e3 * v:g}" for v in PLACES["A"])
    assert calibrate(tmp_path, table, "--target", place) == 2
    said = capsys.readouterr().err
    assert "the target is given at (30, -20, 120) m" in said and "must be in m, not in mm" in said
    assert not (tmp_path / "out").exists()


def test_a_link_that_a_rod_keeps_level_follows_another_joint(tmp_path: Path) -> None:
    """A palletiser reports nothing for the joint that its rods turn: a column of zeros."""
    arm, generator = ForeignArm(seed=69, coupling=parallelogram(-1.0)), np.random.default_rng(69)
    q = arm.reported(40, generator)
    q[:, 2] = 0.0
    table = saved(tmp_path / "p.csv", f"{ANGLES},x,y,z", q, arm.measured(q, generator))
    found = estimated(tmp_path, table, extend=True)
    assert not found.failures
    (coupling,) = found.to_json()["coupling"]
    assert (coupling["joint"], coupling["by"], coupling["ratio"]) == (3, 2, -1.0)
