"""``armscope calibrate`` as a person runs it."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import EffectTerm
from arm_model.model_file import read_model, write_model
from arm_model.rigid_body.kinematics import forward
from arm_model.urdf import read_urdf, write_urdf
from armscope.cli import run
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from experiment import read_experiment

sys.path.insert(0, str(Path(__file__).parent))
from arms import NOISE, motion, puma, seen, with_errors

RIG = 'name = "test"\n' + "[[joint]]\n" * 6 + "[tracker]\ntarget = [0.05, 0.0, 0.10]\n"


@pytest.fixture(scope="module")
def recordings(root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    nominal = puma(root)
    true = with_errors(nominal, np.random.default_rng(31))
    for name, seed in (("a", 1), ("b", 2)):
        generator = np.random.default_rng(seed)
        t, q = motion(nominal, 10.0, generator, 100.0)
        xyz = seen(true, q) + generator.normal(size=(len(t), 3)) * NOISE
        xyz[::7] = np.nan
        write_table(folder / f"{name}.mcap", t, {"q": q, "i": np.zeros_like(q), "xyz": xyz}, Attachments(rig=RIG))
    return folder / "a.mcap", folder / "b.mcap"


def calibrate(root: Path, *arguments: str | Path) -> int:
    return run(["calibrate", *map(str, arguments), "--model", str(root / "config/models/puma560.toml")])


def test_writes_what_the_contract_says(root: Path, recordings, tmp_path: Path, capsys) -> None:
    fitted, held = recordings
    out = tmp_path / "out"
    assert calibrate(root, fitted, "--held-out", held, "--out", out, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    table = json.loads((out / "kinematics.json").read_text())
    assert printed == table
    assert table["schema"] == "armscope.kinematics/1"
    assert [row["joint"] for row in table["parameters"]] == [1, 2, 3, 4, 5, 6]
    assert set(table["position_rms"]) == {"fit", "held_out"}
    rms = table["position_rms"]["held_out"]
    assert rms["after"] < 1.05 * NOISE < 0.02 * rms["before"]
    assert table["identifiable"] == 27
    page = (out / "report.html").read_text()
    assert 'wide still"><svg' in page
    assert "http" not in page
    # the model file says the same, and is a model like any other: calibrating with it finds nothing left to do
    assert read_model(out / "model.toml").joints[1].beta == table["parameters"][1]["beta"]
    again = tmp_path / "again"
    assert (
        run(
            ["calibrate", str(fitted), "--held-out", str(held), "--model", str(out / "model.toml"), "--out", str(again)]
        )
        == 0
    )
    rms = json.loads((again / "kinematics.json").read_text())["position_rms"]["held_out"]
    assert rms["before"] == pytest.approx(rms["after"], rel=0.02)


def test_plans_poses_and_the_cube_without_a_recording(root: Path, tmp_path: Path, capsys) -> None:
    assert calibrate(root, "--out", tmp_path, "--poses", "12", "--target", "0.05,0,0.1", "--cube") == 0
    assert len(read_experiment(tmp_path / "poses.toml").segment) == 24
    assert read_experiment(tmp_path / "iso_cube.toml").name == "iso_cube"
    assert "poses.toml" in capsys.readouterr().out


def test_what_a_script_needs_of_poses_and_cube_is_in_the_json(root: Path, tmp_path: Path, capsys) -> None:
    assert (
        calibrate(
            root, "--out", tmp_path, "--poses", "9", "--target", "0.05,0,0.1", "--cube", "--json", "--memory", "900"
        )
        == 0
    )
    printed = json.loads(capsys.readouterr().out)
    plan, cube = printed["poses"], printed["cube"]
    experiment = read_experiment(Path(plan["file"]))
    moves = [s.to for s in experiment.segment if s.type == "move"]
    np.testing.assert_allclose(plan["q"], moves, atol=1e-6)
    assert plan["rate"] * plan["duration"] <= 900
    assert len(plan["error"]) == 9
    assert set(plan["observability"]) == {"o1", "o2", "o3", "o4", "o5"}
    nominal = puma(root)
    reached = forward(nominal, np.array(cube["targets"]))[:, :3, 3]
    np.testing.assert_allclose(reached, cube["points"], atol=1e-6)
    assert "corrected_file" not in cube


def test_files_of_an_earlier_calibration_do_not_stay_beside_a_new_one(
    root: Path, recordings, tmp_path: Path, monkeypatch
) -> None:
    def there() -> set[str]:
        return {path.name for path in out.glob("[!.]*")}

    fitted, held = recordings
    out = tmp_path / "out"
    assert calibrate(root, "--out", out, "--poses", "5", "--target", "0.05,0,0.1") == 0
    with monkeypatch.context() as patch:
        interrupted = "identification.kinematics.use.pose_files.write_experiment"
        patch.setattr(interrupted, lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
        assert calibrate(root, fitted, "--held-out", held, "--out", out, "--cube") == 130
    assert there() == {"poses.toml"}
    calibration = {"kinematics.json", "report.html", "model.toml", "model_kinematic_uncertainty.json"}
    calibration |= {"residuals.csv", "poses.toml"}  # the plan stays
    assert calibrate(root, fitted, "--held-out", held, "--out", out, "--cube") == 0
    assert there() == calibration | {"iso_cube.toml", "iso_cube_corrected.toml"}
    assert calibrate(root, fitted, "--held-out", held, "--out", out) == 0
    assert there() == calibration


def test_a_model_from_urdf_is_given_d_h_parameters(root: Path, recordings, tmp_path: Path) -> None:
    """The target stays where it is on the arm, though the last link's frame is another.

    The result is a model like any other.
    """
    fitted, held = recordings
    write_urdf(tmp_path / "puma.urdf", puma(root))
    write_model(tmp_path / "placed.toml", read_urdf(tmp_path / "puma.urdf"))
    out, model = tmp_path / "out", str(tmp_path / "placed.toml")
    assert run(["calibrate", str(fitted), "--held-out", str(held), "--model", model, "--out", str(out)]) == 0
    table = json.loads((out / "kinematics.json").read_text())
    assert table["position_rms"]["held_out"]["after"] < 1.05 * NOISE
    assert table["identifiable"] == 27
    assert {joint.convention for joint in read_model(out / "model.toml").joints} == {"standard"}


def test_a_model_with_effects_of_geometry_is_calibrated_from_where_they_put_it(
    root: Path, recordings, tmp_path: Path
) -> None:
    """Sag that the model claims and the points do not show goes; a geometric effect becomes the joint's own number."""
    fitted, held = recordings
    terms = (
        EffectTerm("link_geometry", 2, {"d_a": 0.004}),
        EffectTerm("joint_zero_offset", 3, {"offset": 0.01}),
        EffectTerm("link_sag", 2, {"compliance": 1e-4}),
    )
    write_model(tmp_path / "bent.toml", replace(puma(root), effects=terms))
    out = tmp_path / "out"
    model = str(tmp_path / "bent.toml")
    assert run(["calibrate", str(fitted), "--held-out", str(held), "--model", model, "--out", str(out)]) == 0
    assert json.loads((out / "kinematics.json").read_text())["position_rms"]["held_out"]["after"] < 1.05 * NOISE
    assert read_model(out / "model.toml").effects == ()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "RUN.mcap: is missing"),
        (["absent.mcap"], "absent.mcap"),
        (["--poses", "9"], "--target: is missing"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(root: Path, tmp_path: Path, capsys, arguments, reason) -> None:
    assert calibrate(root, *arguments, "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert reason in error
    assert not list((tmp_path / "out").glob("*"))


def test_a_recording_without_points_is_refused(root: Path, tmp_path: Path, capsys) -> None:
    t = np.arange(20) * 0.01
    write_table(tmp_path / "r.mcap", t, {"q": np.zeros((20, 6)), "i": np.zeros((20, 6))}, Attachments(rig=RIG))
    assert calibrate(root, tmp_path / "r.mcap", "--out", tmp_path / "out") == 2
    assert "has no tracker points" in capsys.readouterr().err


def test_a_separate_tracker_file_is_merged(root: Path, tmp_path: Path, capsys) -> None:
    nominal = puma(root)
    true = with_errors(nominal, np.random.default_rng(32))
    generator = np.random.default_rng(33)
    t, q = motion(nominal, 10.0, generator, 100.0)
    t = t + np.cumsum(generator.normal(size=len(t)) * 2e-5)
    t -= t[0]
    xyz = seen(true, q) + generator.normal(size=(len(t), 3)) * NOISE
    write_table(tmp_path / "r.mcap", t[3:], {"q": q[3:], "i": np.zeros_like(q[3:])}, Attachments(rig=RIG))
    rows = [f"{12 + (1 + 1e-5) * s:.7f},{p[0]:.6f},{p[1]:.6f},{p[2]:.6f}" for s, p in zip(t, xyz)]
    (tmp_path / "t.csv").write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    out = tmp_path / "out"
    assert calibrate(root, tmp_path / "r.mcap", "--tracker", tmp_path / "t.csv", "--out", out) == 0
    table = json.loads((out / "kinematics.json").read_text())
    assert table["position_rms"]["held_out"]["after"] < 1.1 * NOISE
    assert table["tracker_frame"]["known"] is False
