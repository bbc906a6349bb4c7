"""Several reflectors per pose, orientations, and targets of their own for every table, on an arm of foreign code."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armscope
from arm_model.rigid_body.kinematics import link_frames
from armscope.cli import run
from identification.kinematics.data.pose_table import read_poses
from identification.kinematics.data.runs import Run, correlation_in_poses
from identification.kinematics.models.chain import Chain, Step, forward, pose_jacobian, position_jacobian
from identification.kinematics.report.html import headline

sys.path.insert(0, str(Path(__file__).parent))
from foreign_arm import DESCRIPTION, NOISE, ForeignArm

PLACES = {"A": (0.03, -0.02, 0.12), "B": (-0.11, 0.05, 0.08), "C": (0.04, 0.13, 0.03)}
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
AIM = Rotation.from_euler("zyx", [2.0, -0.9, 0.4])
SHIFT = np.array([2.0, -1.0, 0.5])
ANGLES = ",".join(f"q{j}" for j in range(1, 7))


def seen(arm: ForeignArm, q: np.ndarray, name: str, generator: np.random.Generator) -> np.ndarray:
    """(N, 3) m of one reflector, in a tracker's own frame."""
    noise = generator.normal(size=(len(q), 3)) * NOISE
    return arm.points(q, PLACES[name]) @ TURN.T + SHIFT + noise


def turned(arm: ForeignArm, q: np.ndarray, generator: np.random.Generator, noise: float) -> Rotation:
    """Orientations of a 6-D target, whose frame is turned by ``AIM`` on the link."""
    sides = [arm.points(q, tuple(np.eye(3)[k])) - arm.points(q, (0.0, 0, 0)) for k in range(3)]
    link = Rotation.from_matrix(TURN @ np.stack(sides, axis=2))
    return Rotation.from_rotvec(generator.normal(size=(len(q), 3)) * noise) * link * AIM


def saved(path: Path, head: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), fmt="%.9f", delimiter=",", header=head, comments="")
    path.write_text(path.read_text().replace("nan", ""))
    return path


def calibrate(folder: Path, *arguments: str | Path) -> int:
    (folder / "foreign.toml").write_text(DESCRIPTION)
    common = ["--model", folder / "foreign.toml", "--out", folder / "out", "--geometry-only"]
    return run(["calibrate", *map(str, arguments), *map(str, common)])


def estimated(folder: Path, *tables: Path, target: dict | None = None, extend: bool = False) -> armscope.Calibration:
    """The same without a report; ``extend``: couplings, sag and encoder errors are tried."""
    (folder / "foreign.toml").write_text(DESCRIPTION)
    known = armscope.Tracker(target=target)
    return armscope.calibrate(tables, folder / "foreign.toml", tracker=known, geometry_only=not extend)


def model_error(found: armscope.Calibration, arm: ForeignArm, q: np.ndarray, name: str = "A", number: int = 0) -> float:
    """rms m per coordinate of the calibrated model, for a reflector of poses q, against the true arm."""
    table = found.to_json()
    at = (link_frames(found.model, q)[:, -1] @ np.array(table["targets"][number]["pose"]))[:, :3, 3]
    pose = np.linalg.inv(np.array(table["tracker_frame"]["base_from_tracker"]))
    truth = arm.points(q, PLACES[name]) @ TURN.T + SHIFT
    return float(np.sqrt(np.mean((at @ pose[:3, :3].T + pose[:3, 3] - truth) ** 2)))


@pytest.mark.slow
def test_three_reflectors_beat_one(tmp_path: Path) -> None:
    """The same poses; error of the model against the true arm at each reflector, on poses that nobody fitted."""
    alone, together = [], []
    for seed in (21, 22):
        arm, generator = ForeignArm(seed=seed), np.random.default_rng(seed)
        q, unseen = arm.reported(40, generator), arm.reported(100, generator)
        points = [seen(arm, q, name, generator) for name in PLACES]
        for name, xyz in zip(PLACES, points, strict=True):
            found = estimated(tmp_path, saved(tmp_path / "one.csv", f"{ANGLES},x,y,z", q, xyz))
            alone.append(model_error(found, arm, unseen, name))
        found = estimated(tmp_path, saved(tmp_path / "three.csv", f"{ANGLES},x1,y1,z1,x2,y2,z2,x3,y3,z3", q, *points))
        assert found.details.identifiable == 33
        together += [model_error(found, arm, unseen, name, k) for k, name in enumerate(PLACES)]
    assert np.sqrt(np.mean(np.square(together))) < 0.7 * np.sqrt(np.mean(np.square(alone)))


def test_rows_with_a_reflector_column_are_the_same_as_columns(tmp_path: Path) -> None:
    arm, generator = ForeignArm(seed=24), np.random.default_rng(24)
    q = arm.reported(30, generator)
    points = {name: seen(arm, q, name, generator) for name in PLACES}
    points["B"][4:12] = np.nan
    wide = saved(tmp_path / "wide.csv", f"{ANGLES},x1,y1,z1,x2,y2,z2,x3,y3,z3", q, *points.values())
    lines = [f"reflector,{ANGLES},x,y,z"]
    for k, angles in enumerate(q):
        for name, xyz in points.items():
            if np.isfinite(xyz[k]).all():
                lines.append(",".join([name, *(f"{v:.9f}" for v in (*angles, *xyz[k]))]))
    (tmp_path / "long.csv").write_text("\n".join(lines) + "\n")
    columns = estimated(tmp_path, wide).to_json()
    assert calibrate(tmp_path, tmp_path / "long.csv") == 0
    rows = json.loads((tmp_path / "out/kinematics.json").read_text())
    assert [one["name"] for one in rows["targets"]] == ["A", "B", "C"]
    assert [one["name"] for one in columns["targets"]] == ["1", "2", "3"]
    assert rows["position_rms"]["fit"]["after"] == pytest.approx(columns["position_rms"]["fit"]["after"], rel=1e-6)
    assert columns["position_error"]["held_out"]["after"]["points"] == 90 - 8
    assert columns["held_out"] == "cross-validation"
    assert columns["position_rms"]["held_out"]["after"] < 2 * NOISE


def test_orientations_are_read_however_they_are_written(tmp_path: Path) -> None:
    turns = Rotation.from_rotvec(np.random.default_rng(25).normal(size=(5, 3)))
    written = {
        "qw,qx,qy,qz": -turns.as_quat()[:, [3, 0, 1, 2]],
        "rx,ry,rz": turns.as_rotvec(),
        "roll,pitch,yaw": turns.as_euler("xyz"),
    }
    for head, values in written.items():
        path = saved(tmp_path / "p.csv", f"{ANGLES},x,y,z,{head}", np.zeros((5, 6)), np.ones((5, 3)), values)
        positions, oriented = read_poses(path, 6).runs
        assert not positions.lever and oriented.lever
        assert (Rotation.from_rotvec(oriented.xyz) * turns.inv()).magnitude().max() < 1e-8


def test_orientations_are_fitted_with_their_own_noise(tmp_path: Path) -> None:
    """A 6-D target: its frame on the link is found, and the model is better than without orientations."""
    arm, generator = ForeignArm(seed=25), np.random.default_rng(25)
    q, unseen = arm.reported(40, generator), arm.reported(200, generator)
    xyz, turns = seen(arm, q, "A", generator), turned(arm, q, generator, 5e-5)
    head, values = "qw,qx,qy,qz", turns.as_quat()[:, [3, 0, 1, 2]]
    bare = estimated(tmp_path, saved(tmp_path / "p.csv", f"{ANGLES},x,y,z", q, xyz))
    found = estimated(tmp_path, saved(tmp_path / "p.csv", f"{ANGLES},x,y,z,{head}", q, xyz, values))
    table = found.to_json()
    assert table["identifiable"] == 30
    assert model_error(found, arm, unseen) < model_error(bare, arm, unseen)
    assert table["orientation_rms"]["held_out"]["after"] == pytest.approx(5e-5, rel=0.4)
    assert table["orientation_rms"]["held_out"]["before"] > 1e-3
    assert table["position_error"]["held_out"]["after"]["points"] == 40
    assert table["left_out"] == []
    turns[7] = turns[7] * Rotation.from_rotvec([0.0, 4e-3, 0.0])
    values = turns.as_quat()[:, [3, 0, 1, 2]]
    wrong = estimated(tmp_path, saved(tmp_path / "p.csv", f"{ANGLES},x,y,z,{head}", q, xyz, values))
    left = [one for one in wrong.to_json()["left_out"] if one["part"] == "fit"]
    assert [(one["quantity"], one["rows"]) for one in left] == [("orientation", [8])]
    wrong.write(tmp_path / "out")
    assert re.search(r"p\.csv orientation row 8: 4\.?\d* mrad off", (tmp_path / "out/report.html").read_text())
    # its frame on the link, with the arm's own orientation error of the last links
    turn = Rotation.from_matrix(np.array(table["targets"][0]["pose"])[:3, :3])
    assert (turn.inv() * AIM).magnitude() < 0.03


def test_every_table_may_have_a_target_of_its_own(tmp_path: Path, capsys) -> None:
    """Two tables with the reflector mounted elsewhere; the second place is not known, and is found."""
    arm, generator = ForeignArm(seed=26), np.random.default_rng(26)
    q, more = arm.reported(40, generator), arm.reported(30, generator)
    first = saved(tmp_path / "first.csv", f"{ANGLES},x,y,z", q, seen(arm, q, "A", generator))
    other = saved(tmp_path / "other.csv", f"{ANGLES},x,y,z", more, seen(arm, more, "C", generator))
    assert calibrate(tmp_path, first, other) == 2  # taken for one target, the tables contradict each other
    assert "not calibrated" in capsys.readouterr().err
    places = ["--target", f"first.csv={','.join(map(str, PLACES['A']))}", "--target", "other.csv=unknown"]
    assert calibrate(tmp_path, first, other, *places) == 0
    found = estimated(tmp_path, first, other, target={"first.csv": PLACES["A"], "other.csv": None})
    table = found.to_json()
    assert table == json.loads((tmp_path / "out/kinematics.json").read_text())
    assert table["position_rms"]["held_out"]["after"] < 1.5 * NOISE
    # A place that nobody knows is found up to what the last link's zero and length take.
    at = [np.array(one["pose"])[:3, 3] for one in table["targets"]]
    np.testing.assert_allclose(at[0], PLACES["A"], atol=3e-4)
    np.testing.assert_allclose(at[1], PLACES["C"], atol=2e-3)
    assert model_error(found, arm, more, "C", 1) < NOISE


def test_places_in_the_table_are_taken(tmp_path: Path) -> None:
    place = ",".join(f"target_{axis}" for axis in "xyz")
    q = np.zeros((3, 6))
    table = saved(tmp_path / "p.csv", f"{ANGLES},x,y,z,{place}", q, np.ones((3, 3)), np.tile(PLACES["B"], (3, 1)))
    assert read_poses(table, 6).target == PLACES["B"]


@pytest.mark.parametrize(
    ("head", "line", "reason"),
    [
        (
            f"{ANGLES},x,y,z,qw,qx,qy",
            "0,0,0,0,0,0,1,1,1,1,0,0",
            "column qz is missing; an orientation must be given as",
        ),
        (f"{ANGLES},x,y,z,qw,qx,qy,qz", "0,0,0,0,0,0,1,1,1,1,1,0,0", "line 2: qw, qx, qy, qz: is no unit quaternion"),
        (f"{ANGLES},x,y,z,roll,pitch,yaw", "0,0,0,0,0,0,1,1,1,90,0,0", "roll, pitch, yaw: 90 is no value in rad"),
        (f"{ANGLES},x,y,z,rx,ry,rz,qw", "0,0,0,0,0,0,1,1,1,0,0,0,1", "give orientations twice"),
        (f"{ANGLES},x1,y1,z1,x2,y2", "0,0,0,0,0,0,1,1,1,1,1", "column z2 is missing"),
        (f"{ANGLES},x1,y1,z1,x", "0,0,0,0,0,0,1,1,1,1", "has columns x and x1"),
        (f"{ANGLES},reflector,x,y,z", "0,0,0,0,0,0,,1,1,1", "line 2: reflector: is empty"),
        (f"t,{ANGLES},reflector,x,y,z", "0,0,0,0,0,0,0,A,1,1,1", "has columns t and reflector"),
        (
            f"{ANGLES},x1,y1,z1,x2,y2,z2",
            "0,0,0,0,0,0,1,1,1,,,\n" + "1,0,0,0,0,0,1,1,1,,,\n" * 10,
            "reflector 2: no row",
        ),
    ],
)
def test_another_table_is_refused_in_one_line(tmp_path: Path, capsys, head: str, line: str, reason: str) -> None:
    (tmp_path / "poses.csv").write_text(f"{head}\n{line}\n")
    assert calibrate(tmp_path, tmp_path / "poses.csv") == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert reason in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (["0,0,0.1"], "there are 2 reflectors (1, 2); give NAME=X,Y,Z"),
        (["B=0,0,0.1"], "'B' is neither a reflector nor a file of these: '1', '2', 'p.csv'"),
        (["p.csv=0,0,0.1"], "p.csv has 2 reflectors"),
        (["1=0,0,0.1", "1=0,0,0.2"], "is given twice for 1"),
        (["1=0,0"], "must be three numbers X,Y,Z"),
    ],
)
def test_a_target_that_is_not_there_is_refused(tmp_path: Path, capsys, given: list[str], reason: str) -> None:
    q = np.random.default_rng(0).normal(size=(12, 6))
    table = saved(tmp_path / "p.csv", f"{ANGLES},x1,y1,z1,x2,y2,z2", q, np.ones((12, 6)))
    assert calibrate(tmp_path, table, *(part for one in given for part in ("--target", one))) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


def test_a_held_out_target_that_nobody_knows_is_refused(tmp_path: Path, capsys) -> None:
    arm, generator = ForeignArm(seed=27), np.random.default_rng(27)
    q = arm.reported(30, generator)
    first = saved(tmp_path / "a.csv", f"{ANGLES},x,y,z", q, seen(arm, q, "A", generator))
    other = saved(tmp_path / "b.csv", f"{ANGLES},x,y,z", q, seen(arm, q, "C", generator))
    assert calibrate(tmp_path, first, "--held-out", other, "--target", "b.csv=unknown") == 2
    assert "b.csv: its target b.csv is in no fitted recording" in capsys.readouterr().err


def test_derivatives_of_several_targets_are_those_of_differences() -> None:
    """Positions and orientations of two targets behind one joint: every column against a central difference."""
    generator = np.random.default_rng(28)
    steps = [Step("rz", 0.3, "joint1.theta", 0), Step("tx", 0.4, "joint1.a"), Step("rx", -0.7, "joint1.alpha")]
    for k in range(2):
        values = generator.normal(size=6)
        motions = ("tx", "ty", "tz", "rz", "ry", "rx")
        steps += [Step(m, float(v), f"target{k + 1}.{m}", None, k) for m, v in zip(motions, values)]
    chain, q, target = Chain(tuple(steps)), generator.normal(size=(6, 1)), np.array([0, 1, 0, 1, 1, 0])
    moves, turns = position_jacobian(chain, q, target)[1], pose_jacobian(chain, q, target)[1]
    for k in range(len(steps)):
        step = np.zeros(len(steps))
        step[k] = 1e-6
        high, low = (forward(chain.at(chain.values + sign * step), q, target) for sign in (1, -1))
        np.testing.assert_allclose((high - low)[:, :3, 3] / 2e-6, moves[:, :, k], atol=1e-8)
        turn = (Rotation.from_matrix(high[:, :3, :3]) * Rotation.from_matrix(low[:, :3, :3]).inv()).as_rotvec()
        np.testing.assert_allclose(turn / 2e-6, turns[:, :, k], atol=1e-8)


def test_reflectors_of_one_pose_count_as_fewer_where_they_share_an_error() -> None:
    """Three residuals of one pose, independent, and with a common part as large as their own."""
    generator = np.random.default_rng(29)
    t, rows = np.arange(400.0), [np.arange(400)] * 3
    runs = [Run(f"p reflector {k}", t, np.zeros((400, 1)), np.zeros((400, 3)), recorded="p") for k in range(3)]
    own = generator.normal(size=(3, 400, 3))
    common = own + generator.normal(size=(400, 3))
    assert correlation_in_poses(own.reshape(-1, 3), runs, rows) == pytest.approx(1.0, abs=0.15)
    assert correlation_in_poses(common.reshape(-1, 3), runs, rows) == pytest.approx(2.0, abs=0.2)
    assert correlation_in_poses(common[0], runs[:1], rows[:1]) == 1.0


NO_OUTLIERS = {"held_out": {"after": {"outliers": 0}}}


def test_the_page_leads_with_the_errors_of_positions_and_orientations() -> None:
    table = {
        "position_rms": {"held_out": {"before": 2e-3, "after": 5e-5}},
        "position_error": NO_OUTLIERS,
        "orientation_rms": {"held_out": {"before": 7.43e-3, "after": 1.25e-4}},
        "improvement": {"held_out": 0.975},
        "held_out": ["held.csv"],
        "failures": [],
        "noise": 4e-5,
        "point_std": None,
    }
    said, refuted = headline(table)
    assert not refuted
    assert said.endswith("The orientation error was 7.43 mrad rms per coordinate, and is 0.125 mrad.")
    assert "orientation" not in headline(table | {"orientation_rms": {}})[0]
    assert "0.04 mm, as stated." in headline(table | {"point_std": 4e-5})[0]


@pytest.mark.parametrize(("improvement", "refuted"), [(-0.001, False), (-0.2, True)])
def test_a_model_that_needs_no_calibration_is_no_failure(improvement: float, refuted: bool) -> None:
    rms = {"before": 2e-4, "after": 2e-4 * (1 - improvement)}
    table = {"position_rms": {"held_out": rms}, "improvement": {"held_out": improvement}, "orientation_rms": {}}
    more = {"held_out": ["held.csv"], "failures": [], "noise": 4e-5, "point_std": None, "position_error": NO_OUTLIERS}
    assert headline(table | more)[1] is refuted
