"""``armscope calibrate`` on an arm that shares no code with it: coupled joints, wrong targets, wrong points."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import link_frames
from armscope.cli import run
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.map_estimation import fit
from identification.kinematics.estimation.outlier_pattern import shared
from identification.kinematics.models.parameters import Target, Trust, parameters_of
from identification.kinematics.report.write import change, coupling_equations

sys.path.insert(0, str(Path(__file__).parent))
from foreign_arm import DESCRIPTION, NOISE, TARGET, ForeignArm, parallelogram, sweeps

RIG = 'name = "foreign"\n' + "[[joint]]\n" * 6 + "[tracker]\n"
GIVEN = ",".join(map(str, TARGET))


def described(folder: Path) -> Path:
    path = folder / "foreign.toml"
    path.write_text(DESCRIPTION)
    return path


def recorded(path: Path, q: np.ndarray, xyz: np.ndarray) -> Path:
    """A recording of poses, a second each."""
    write_table(path, np.arange(len(q)) * 1.0, {"q": q, "i": 0 * q, "xyz": xyz}, Attachments(rig=RIG))
    return path


def calibrated(folder: Path, arm: ForeignArm, q: np.ndarray, *, target: str = GIVEN) -> tuple[int, np.ndarray]:
    """Exit status of calibrating with reported angles q, and the held-out residuals (60, 3) m of the model written.

    By the model file and the tool alone, as a person would use them.
    """
    generator = np.random.default_rng(1)
    unseen = arm.reported(60, generator)
    fitted = recorded(folder / "fit.mcap", q, arm.measured(q, generator))
    held = recorded(folder / "held.mcap", unseen, arm.measured(unseen, generator))
    out = folder / "out"
    model = described(folder)
    status = run(
        ["calibrate", str(fitted), "--held-out", str(held), "--model", str(model), "--out", str(out)]
        + ["--target", target, "--geometry-only" if np.array_equal(arm.coupling, np.eye(6)) else "--json"]
    )
    if status:
        return status, np.zeros((0, 3))
    found, tool = read_model(out / "model.toml"), np.array(table_of(folder)["tool"])
    ends = link_frames(found, found.link_angles(unseen))[:, -1] @ tool
    return status, arm.points(unseen) - ends[:, :3, 3]


def table_of(folder: Path) -> dict:
    return json.loads((folder / "out/kinematics.json").read_text())


def rms(residual: np.ndarray) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def test_the_description_is_the_arm(tmp_path: Path) -> None:
    """Two independent forward kinematics of the same data sheet."""
    arm, ideal = read_model(described(tmp_path)), ForeignArm(angle=0.0, length=0.0)
    ideal.zero[:] = 0.0
    q = np.random.default_rng(0).normal(size=(8, 6))
    ends = link_frames(arm, q)[:, -1]
    np.testing.assert_allclose(ends[:, :3, :3] @ np.array(TARGET) + ends[:, :3, 3], ideal.points(q), atol=1e-12)


@pytest.mark.parametrize(
    ("matrix", "entry"),
    [(parallelogram(1.0), (3, 2, 1.0)), (np.diag([1.0, 1, 1, -1, 1, 1]), (4, 4, -1.0))],
    ids=["coupled", "counted backwards"],
)
def test_coupled_joints_are_found_and_written_into_the_model(tmp_path: Path, matrix, entry) -> None:
    """60 poses, noise 0.03 mm: the error of the model file itself on poses that nobody fitted."""
    arm = ForeignArm(seed=3, coupling=matrix)
    status, residual = calibrated(tmp_path, arm, arm.reported(60, np.random.default_rng(2)))
    assert status == 0
    assert rms(residual) < NOISE
    (found,) = table_of(tmp_path)["coupling"]
    assert (found["joint"], found["by"], found["ratio"]) == entry
    assert table_of(tmp_path)["position_rms"]["held_out"]["after"] < 1.3 * NOISE


def test_a_coupling_by_a_fraction_is_estimated(tmp_path: Path) -> None:
    arm = ForeignArm(seed=4, coupling=parallelogram(0.37))
    status, residual = calibrated(tmp_path, arm, arm.reported(60, np.random.default_rng(2)))
    assert status == 0
    assert rms(residual) < NOISE
    (found,) = table_of(tmp_path)["coupling"]
    assert 0 < found["std"] < 1e-3
    assert found["ratio"] == pytest.approx(0.37, abs=5 * found["std"])


def test_an_arm_with_a_parallelogram_that_sags_is_not_coupled_by_a_fraction(tmp_path: Path) -> None:
    """The ratio is -1 and joint 2 gives way: not a ratio of -0.9995 that imitates it."""
    arm = ForeignArm(seed=12, coupling=parallelogram(-1.0), sag=2e-6)
    assert calibrated(tmp_path, arm, arm.reported(45, np.random.default_rng(13)))[0] == 0
    (found,) = table_of(tmp_path)["coupling"]
    assert (found["joint"], found["by"], found["ratio"]) == (3, 2, -1.0)
    (effect,) = table_of(tmp_path)["effects"]
    assert effect["title"] == "link_sag of joint 2"
    assert table_of(tmp_path)["position_rms"]["held_out"]["after"] < 1.3 * NOISE


def test_a_coupling_and_an_improvement_are_said_as_they_are() -> None:
    entries = [(3, 2, -1.0, 0.0), (4, 4, -1.0, 0.0), (6, 5, 0.25, 1e-4)]
    table = {"coupling": [dict(zip(("joint", "by", "ratio", "std"), entry)) for entry in entries]}
    assert [line.partition(" (q:")[0] for line in coupling_equations(table)] == [
        "link angle 3 = q3 - q2",
        "link angle 4 = - q4",
        "link angle 6 = q6 + (0.25000 +- 0.00020) q5",
    ]
    assert [change(x, 1e-3) for x in (0.99958, 0.9, -0.25, 1.0, -0.0002)] == [
        "99.96 % better",
        "90 % better",
        "25 % worse",
        "100 % better",
        "unchanged",
    ]
    assert change(-2e6, 1.7e-7) == "both below 0.001 mm"


def test_no_sweep_is_thrown_out_for_a_coupling(tmp_path: Path) -> None:
    """The sweeps of a coupled arm: all poses are kept, and what the report leads with holds on all held-out poses."""
    arm = ForeignArm(seed=3, coupling=parallelogram())
    status, residual = calibrated(tmp_path, arm, sweeps(arm))
    assert status == 0
    table = table_of(tmp_path)
    assert table["left_out"] == []
    assert rms(residual) < 2e-4
    assert table["position_rms"]["held_out"]["after"] == pytest.approx(rms(residual), rel=0.2)
    assert table["tracker_frame"]["known"]


def test_poses_that_no_coupling_explains_are_no_success(tmp_path: Path, capsys) -> None:
    """A joint that slips in a third of its range: refused in one line that says where, and nothing is written."""
    arm, generator = ForeignArm(seed=5), np.random.default_rng(6)
    q = arm.reported(60, generator)
    slipped = q.copy()
    slipped[q[:, 1] < -1.6, 1] += 0.03
    fitted = recorded(tmp_path / "fit.mcap", q, arm.measured(slipped, generator))
    out = tmp_path / "out"
    status = run(["calibrate", str(fitted), "--model", str(described(tmp_path)), "--out", str(out), "--target", GIVEN])
    error = capsys.readouterr().err
    assert status == 2
    assert error.count("\n") == 1
    assert "fit.mcap: not calibrated" in error
    assert "joint 2" in error
    assert not out.exists()


@pytest.mark.parametrize("given", ["0.03,-0.02,0.02", "0.12,0.03,0.02"])
def test_a_target_given_in_another_frame_is_noticed(tmp_path: Path, capsys, given: str) -> None:
    arm = ForeignArm(seed=5)
    status, residual = calibrated(tmp_path, arm, arm.reported(60, np.random.default_rng(2)), target=given)
    assert status == 0
    assert "chi-square" in capsys.readouterr().err
    assert rms(residual) < NOISE


def test_before_is_after_the_best_fit_of_frame_and_target(tmp_path: Path) -> None:
    """A tracker and a target 40 mm off are no errors of the arm."""
    arm = ForeignArm(seed=5, angle=1e-4, length=1e-4)
    arm.flange = arm.flange @ np.array([[1.0, 0, 0, 0.04], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    calibrated(tmp_path, arm, arm.reported(60, np.random.default_rng(2)))
    assert table_of(tmp_path)["position_rms"]["held_out"]["before"] < 1e-3


def test_good_poses_are_not_left_out_however_few(tmp_path: Path) -> None:
    """Twenty poses for 27 parameters: none is dropped; two wrong ones are, and they alone."""
    nominal = read_model(described(tmp_path))
    parameters = parameters_of(nominal, [Target(TARGET)], frame_known=True, trust=Trust())
    for seed in range(4):
        arm, generator = ForeignArm(seed=seed), np.random.default_rng(100 + seed)
        q = arm.reported(20, generator)
        xyz = arm.measured(q, generator)
        assert fit(parameters, Points(q, xyz)).inlier.all()
        xyz[:2] += generator.normal(size=(2, 3)) * 5e-3
        assert list(np.flatnonzero(~fit(parameters, Points(q, xyz)).inlier)) == [0, 1]


def test_every_held_out_point_counts(tmp_path: Path) -> None:
    """Two wrong held-out points: in the figure that leads, out of the one beside it, listed by row."""
    arm, generator = ForeignArm(seed=7), np.random.default_rng(8)
    q, unseen = arm.reported(60, generator), arm.reported(60, generator)
    xyz = arm.measured(unseen, generator)
    xyz[[4, 40]] += [[0.003, 0, 0], [0, 0.002, 0]]
    fitted = recorded(tmp_path / "fit.mcap", q, arm.measured(q, generator))
    held = recorded(tmp_path / "held.mcap", unseen, xyz)
    arguments = ["calibrate", str(fitted), "--held-out", str(held), "--model", str(described(tmp_path))]
    assert run([*arguments, "--out", str(tmp_path / "out"), "--target", GIVEN, "--geometry-only"]) == 0
    table = table_of(tmp_path)
    expected = np.sqrt((0.003**2 + 0.002**2) / 180)
    assert table["position_rms"]["held_out"]["after"] == pytest.approx(expected, rel=0.1)
    assert table["position_rms_inliers"]["held_out"]["after"] < 1.5 * NOISE
    (out,) = table["left_out"]
    assert (out["part"], out["run"], out["rows"]) == ("held_out", "held.mcap", [5, 41])
    assert table["position_error"]["held_out"]["after"]["points"] == 60
    assert table["position_error"]["held_out"]["after"]["largest"] > 0.0028


def test_what_outliers_share_is_named() -> None:
    generator = np.random.default_rng(9)
    q, xyz = generator.uniform(-2, 2, (200, 6)), generator.uniform(-1, 1, (200, 3))
    runs = [np.arange(200)]
    assert shared(q, xyz, generator.random(200) < 0.1, runs) is None
    slides = [False, False, True, False, False, False]
    assert str(shared(q, xyz, q[:, 2] > 1.4, runs)).endswith("angles of joint 3 from 1.45 to 1.99 rad")
    assert str(shared(q, xyz, q[:, 2] > 1.4, runs, slides)).endswith("positions of joint 3 from 1.45 to 1.99 m")
    assert "region z from" in str(shared(q, xyz, xyz[:, 2] < -0.7, runs))
    still = np.zeros((30, 6))
    still[:10, 0], still[10:20, 1], still[20:, 2] = (np.linspace(0, 1, 10) for _ in range(3))
    outlier = np.zeros(30, bool)
    outlier[11:19] = True
    assert shared(still, xyz[:30], outlier, [np.arange(30)]) == "the sweep of joint 2"
