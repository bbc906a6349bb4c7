"""Tables of poses without times or currents, few poses, and what such a table must hold."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from arm_io import InputError
from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import link_frames
from armscope.cli import run
from identification.kinematics.data.pose_table import read_poses

sys.path.insert(0, str(Path(__file__).parent))
from foreign_arm import DESCRIPTION, NOISE, TARGET, ForeignArm, parallelogram

HEAD = "q1,q2,q3,q4,q5,q6,x,y,z"


def table(path: Path, q: np.ndarray, xyz: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack((q, xyz)), fmt="%.7f", delimiter=",", header=HEAD, comments="")
    return path


def calibrate(folder: Path, *arguments: str | Path) -> int:
    (folder / "foreign.toml").write_text(DESCRIPTION)
    common = ["--model", folder / "foreign.toml", "--out", folder / "out", "--geometry-only"]
    return run(["calibrate", *map(str, arguments), *map(str, common)])


def result(folder: Path) -> dict:
    return json.loads((folder / "out/kinematics.json").read_text())


@pytest.mark.parametrize("held", [0, 6])
def test_a_table_of_sixty_poses_is_calibrated_and_cross_validated(tmp_path: Path, held: int) -> None:
    """In the tracker's own frame, with a target that nobody measured; six held-out poses are too few to judge."""
    arm, generator = ForeignArm(seed=11), np.random.default_rng(12)
    q = arm.reported(60 + held, generator)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    xyz = arm.measured(q, generator) @ turn.T + [2.0, -1.0, 0.5]
    arguments: list[str | Path] = [table(tmp_path / "poses.csv", q[:60], xyz[:60])]
    if held:
        arguments += ["--held-out", table(tmp_path / "few.csv", q[60:], xyz[60:])]
    assert calibrate(tmp_path, *arguments) == 0
    found = result(tmp_path)
    assert found["held_out"] == "cross-validation"
    assert found["position_error"]["held_out"]["after"]["points"] == 60 + held
    assert found["identifiable"] == 27
    assert not any("of 27" in warning for warning in found["warnings"])
    assert not found["tracker_frame"]["known"]
    given, calibrated = read_model(tmp_path / "foreign.toml"), read_model(tmp_path / "out/model.toml")
    for entry, before, after in zip(found["corrections"], given.joints, calibrated.joints):
        for name in ("theta", "alpha", "beta", "a", "d"):
            assert entry[name] == pytest.approx(getattr(after, name) - getattr(before, name), abs=1e-12)
    page = (tmp_path / "out/report.html").read_text()
    assert "Corrections" in page and f"{np.degrees(found['corrections'][2]['theta']):.4f}°" in page
    # the promise of cross-validation is kept by the model on other poses
    unseen = arm.reported(200, generator)
    model, pose = read_model(tmp_path / "out/model.toml"), np.array(found["tracker_frame"]["base_from_tracker"])
    ends = (link_frames(model, unseen)[:, -1] @ np.array(found["tool"]))[:, :3, 3]
    seen = (arm.measured(unseen, generator) @ turn.T + [2.0, -1.0, 0.5]) @ pose[:3, :3].T + pose[:3, 3]
    reached = float(np.sqrt(np.mean((seen - ends) ** 2)))
    assert reached == pytest.approx(found["position_rms"]["held_out"]["after"], rel=0.25)
    assert reached < 1.4 * NOISE


def test_no_delay_is_made_up_for_poses_at_rest(tmp_path: Path) -> None:
    arm, generator = ForeignArm(seed=13), np.random.default_rng(14)
    q = arm.reported(40, generator)
    poses = read_poses(table(tmp_path / "poses.csv", q, arm.measured(q, generator)), 6)
    assert not poses.run.velocity().any()
    np.testing.assert_allclose(poses.run.q, q, atol=1e-7)


def test_an_empty_cell_is_a_missing_value_and_extra_columns_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    rows = [f"{k},0.1,0.2,0.3,0.4,0.5,0.{k},1.0,,0.3" for k in range(10, 22)]
    path.write_text("name,q1,q2,q3,q4,q5,q6,x,y,z\n" + "\n".join(rows) + "\n")
    poses = read_poses(path, 6)
    assert len(poses.run.t) == 12
    assert not poses.run.usable.any()
    assert np.isnan(poses.run.xyz[:, 1]).all()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("q1,q2,x,y,z\n0,0,0,0,0\n", "column q3 is missing; a table of poses of this arm must hold q1, q2"),
        (f"{HEAD},q7\n" + "0," * 9 + "0\n", "column q7: the model has 6 joints"),
        ("q1,q2,q3,q4,q5,q6,x1,y1,z1,x2,y2\n", "column z2 is missing"),
        (f"{HEAD}\n" + "90,0,0,0,0,0,1,1,1\n", "q1: 90 is no value in rad, nor in m of a prismatic joint"),
        (f"{HEAD}\n" + "0,0,0,0,0,0,1200,0,1\n", "not in mm"),
        (f"{HEAD}\n" + "0,0,zero,0,0,0,1,0,1\n", "line 2: q3: 'zero' is no number"),
        (f"{HEAD}\n" + "0,0,0,0,0,0,1200,0,1\n", "as in x [mm]"),
        (f"{HEAD}\n".replace("q3", "q3 [grad]"), "'grad' is no unit of q3; must be rad, mrad, deg, °, m, mm, cm"),
        (HEAD.replace(",", ";") + "\n0;0;0;0;0;0;1.000,5;0;1\n", "x, y, z: 1000 is no value in m"),
        (f"{HEAD}\n" + "0,0,0,0,0,0,1,0,1\n" * 5, "5 rows have all joint angles and a tracked point; at least 10"),
        ("", "column q1 is missing"),
        (f"{HEAD}\n" + "0,0,0,0,0,0,1,0,1\n0,,0,0,0,0,0,1,0,1\n", "line 3: has 10 cells; line 1 has 9 names"),
        ("PK\x03\x04\x00" + HEAD, "is no text; save the table as CSV"),
    ],
)
def test_another_table_is_refused_in_one_line(tmp_path: Path, capsys, text: str, reason: str) -> None:
    (tmp_path / "poses.csv").write_text(text)
    assert calibrate(tmp_path, tmp_path / "poses.csv", "--target", ",".join(map(str, TARGET))) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert reason in error
    assert not (tmp_path / "out").exists()


def test_a_table_of_a_spreadsheet_in_degrees_and_mm(tmp_path: Path) -> None:
    """Semicolons, decimal commas, a byte order mark, Windows line ends, units in the names: the numbers of SI units."""
    generator = np.random.default_rng(15)
    q, xyz = generator.uniform(-3, 3, (12, 6)), generator.uniform(-1, 1, (12, 3))
    plain = read_poses(table(tmp_path / "plain.csv", q, xyz), 6)
    rows = np.column_stack((np.degrees(q), 1e3 * xyz))
    head = ";".join(f"{name} [{'deg' if name[0] == 'q' else 'mm'}]" for name in HEAD.split(","))
    lines = [head, *(";".join(f"{value:.5f}".replace(".", ",") for value in row) for row in rows)]
    text = "\r\n".join(lines)
    for content in (
        text.encode("utf-8-sig"),
        text.encode("utf-16"),
        text.replace("[deg]", "[°]").encode("cp1252"),
        text.replace("[deg]", "(deg)").replace("\r\n", ";;\r\n").encode(),  # two empty columns at the right
    ):
        (tmp_path / "sheet.csv").write_bytes(content)
        sheet = read_poses(tmp_path / "sheet.csv", 6)
        np.testing.assert_allclose(sheet.run.q, plain.run.q, atol=2e-7)
        np.testing.assert_allclose(sheet.run.xyz, plain.run.xyz, atol=2e-7)


@pytest.mark.parametrize("head", [HEAD, HEAD.replace("x,y,z", "x1,y1,z1")])
def test_import_says_that_poses_need_no_import(tmp_path: Path, root: Path, capsys, head: str) -> None:
    (tmp_path / "poses.csv").write_text(f"{head}\n" + "0,0,0,0,0,0,1,0,1\n" * 3)
    rig = root / "config/puma560_sim.toml"
    assert run(["import", str(tmp_path / "poses.csv"), "--rig", str(rig), "--out", str(tmp_path / "a.mcap")]) == 2
    assert "armscope calibrate" in capsys.readouterr().err


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(alphabet='q123xyz,.-e\n\r"; \tn', max_size=80), head=st.booleans())
def test_any_text_is_a_table_or_an_input_error(tmp_path: Path, text: str, head: bool) -> None:
    path = tmp_path / "any.csv"
    path.write_text(("q1,x,y,z\n" if head else "") + text)
    try:
        read_poses(path, 1)
    except InputError as error:
        assert "\n" not in str(error)


def test_an_arm_that_does_not_return_exactly_is_calibrated_where_its_user_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Play of 6 mrad at joints 3 to 6 moves the target by 1.3 mm rms per coordinate: more noise than trackers have."""
    arm, generator = ForeignArm(seed=3, angle=1e-2, length=3e-3), np.random.default_rng(8)
    q = arm.reported(100, generator)
    play = np.array([0.0, 0.0, 6e-3, 6e-3, 6e-3, 6e-3]) * generator.choice([-0.5, 0.5], q.shape)
    xyz = arm.measured(q + play, generator)
    files = table(tmp_path / "fit.csv", q[:60], xyz[:60]), "--held-out", table(tmp_path / "held.csv", q[60:], xyz[60:])
    assert calibrate(tmp_path, *files) == 2
    refusal = capsys.readouterr().err
    assert "more noise than a tracker has (at most 1 mm)" in refusal and "--point-std" in refusal
    assert not (tmp_path / "out").exists()
    assert calibrate(tmp_path, *files, "--point-std", "0.0005") == 2
    assert "was stated (at most 1 mm)" in capsys.readouterr().err
    assert calibrate(tmp_path, *files, "--point-std", "0.0015") == 0
    assert "1.5000 mm, as stated" in capsys.readouterr().out
    found = result(tmp_path)
    assert found["noise"] == found["point_std"] == 0.0015
    held_out = found["position_rms"]["held_out"]
    scatter = float(np.sqrt(np.mean((arm.points(q[60:] + play[60:]) - arm.points(q[60:])) ** 2)))
    assert scatter < held_out["after"] < 1.4 * scatter and held_out["after"] < 0.4 * held_out["before"]


def test_no_statement_hides_what_a_model_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A coupling that geometry alone cannot describe leaves centimetres, whatever noise is stated."""
    arm, generator = ForeignArm(seed=9, coupling=parallelogram(0.2)), np.random.default_rng(8)
    q = arm.reported(60, generator)
    poses = table(tmp_path / "poses.csv", q, arm.measured(q, generator))
    assert calibrate(tmp_path, poses, "--point-std", "0.002") == 2
    assert "the model does not describe the poses" in capsys.readouterr().err


@pytest.mark.parametrize("std", ["0", "-0.001", "0.2"])
def test_a_stated_std_is_a_length(tmp_path: Path, capsys: pytest.CaptureFixture[str], std: str) -> None:
    assert calibrate(tmp_path, "poses.csv", "--point-std", std) == 2
    assert "--point-std: must be a length in m between 0 and 0.1" in capsys.readouterr().err


GERMAN = (
    "Messprotokoll;KR 6\r\nBediener;Müller\r\n\r\nPose;Achse 1 [°];Achse 2 [°];X [mm];Y [mm];Z [mm];Bemerkung\r\n{}\r\n"
)
FRENCH = "Point;Réflecteur;Axe1 (deg);Axe2 (deg);X (mm);Y (mm);Z (mm);Écart-type (mm)\n{}\n"
CONTROLLER = "Nr.;A1;A2;X;Y;Z\n-;Grad;Grad;mm;mm;mm\n{}\n"
FROM_ZERO = "joint_0 [deg]\tjoint_1 [deg]\tSMR1_X [mm]\tSMR1_Y [mm]\tSMR1_Z [mm]\n{}\n"


@pytest.mark.parametrize(
    ("text", "row", "encoding", "said"),
    [
        (GERMAN, "1;90,0;-45,5;1000,25;2,0;3,0;ok", "utf-16", "line 4 names the columns: q1 = 'Achse 1 [°]', q2"),
        (GERMAN, "1;90,0;-45,5;1000,25;2,0;3,0;", "cp1252", "z = 'Z [mm]'"),
        (FRENCH, "P1;SMR1;90,0;-45,5;1000,25;2,0;3,0;0,02", "cp1252", "reflector = 'Réflecteur', q1 = 'Axe1 (deg)'"),
        (CONTROLLER, "1;90;-45,5;1000,25;2;3", "utf-8", "q1 = 'A1' (deg), q2 = 'A2' (deg), x = 'X' (mm)"),
        (
            FROM_ZERO,
            "90\t-45,5\t1000,25\t2\t3",
            "utf-8",
            "q1 = 'joint_0 [deg]', q2 = 'joint_1 [deg]', x1 = 'SMR1_X [mm]'",
        ),
    ],
)
def test_tables_that_somebody_else_named(text: str, row: str, encoding: str, said: str, tmp_path: Path) -> None:
    """Every one of them was refused: column q1 is missing, or a row has more cells than the first line."""
    (tmp_path / "p.csv").write_text(text.format(row), encoding=encoding, newline="")
    found = read_poses(tmp_path / "p.csv", 2)
    np.testing.assert_allclose(found.run.q, np.deg2rad([[90.0, -45.5]]))
    np.testing.assert_allclose(found.run.xyz, [[1.00025, 0.002, 0.003]])
    assert said in found.notes[0]


def test_cells_as_people_and_spreadsheets_write_them(tmp_path: Path) -> None:
    """Points that part thousands, and values that are said to be missing, were no numbers."""
    rows = "0,1;0,2;1.250,5;-1.000,0;2,0\n0,1;0,3;-;-;-\n0,1;0,4;#NV;n/a;--\n"
    (tmp_path / "p.csv").write_text("q1;q2;x [mm];y [mm];z [mm]\n" + rows)
    found = read_poses(tmp_path / "p.csv", 2).run
    np.testing.assert_allclose(found.xyz, [[1.2505, -1.0, 0.002], [np.nan] * 3, [np.nan] * 3])
    (tmp_path / "p.csv").write_text("q1;q2;x;y;z\n0,1;0,2;1.25,5;1;1\n")
    with pytest.raises(InputError, match=r"line 2: x: '1.25,5' is no number"):
        read_poses(tmp_path / "p.csv", 2)
    (tmp_path / "p.csv").write_text("q1;q2;x;y;z\n0,1;0,2;1;1;1\n", encoding="utf-16-le")
    with pytest.raises(InputError, match="UTF-16 without a byte order mark"):
        read_poses(tmp_path / "p.csv", 2)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("A1;A2;X [mm];x;Y;Z\n1;2;3;4;5;6\n", r"line 1: column 'x' is there twice \('X \[mm\]', 'x'\)"),
        ("Protokoll\nA1;A2;X;Y;Z\n1;zwei;3;4;5\n", r"line 3: q2: 'zwei' is no number"),
        ("Protokoll\nA1 [inch];A2;X;Y;Z\n1;2;3;4;5\n", r"line 2: 'A1 \[inch\]': 'inch' is no unit of q1"),
        ("A1;A2;X;Y;Z\n90;2;3;4;5\n", r"q1: 90 is no value in rad, nor in m .* as in q1 \[deg\] or q1 \[mm\]$"),
    ],
)
def test_foreign_names_that_cannot_be_meant(text: str, error: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputError, match=error):
        read_poses(tmp_path / "p.csv", 2)
