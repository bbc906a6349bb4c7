"""``armscope simulate``: what it writes reads back, and the published EMPS run comes out as published."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from armscope.cli import run
from daq.recording import open_recording

EXPERIMENT = """
name = "small move"
start = [0, 0, 0, 0, 0, 0]
full_speed = [1, 1, 1, 2, 2, 2]
full_acceleration = [4, 4, 4, 8, 8, 8]
rate = 500
[[segment]]
type = "move"
to = [0.3, 0.2, -0.2, 0.1, 0.1, 0.1]
"""


def test_simulates_an_experiment_and_its_own_recording_alike(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "move.toml").write_text(EXPERIMENT)
    first, again = tmp_path / "a.mcap", tmp_path / "b.mcap"
    model = str(root / "config/models/puma560.toml")
    assert (
        run(["simulate", "--model", model, "--experiment", str(tmp_path / "move.toml"), "--out", str(first), "--json"])
        == 0
    )
    assert json.loads(capsys.readouterr().out)["rows"] == len(open_recording(first))
    assert run(["simulate", "--model", model, "--like", str(first), "--out", str(again), "--target", "0.05,0,0.1"]) == 0
    a, b = open_recording(first), open_recording(again)
    assert a.qref is not None and b.xyz is not None and b.xyz.shape == (len(b), 3)
    assert a.dt == pytest.approx(0.002)
    # Demands that were recorded between the servos' ticks are joined by straight lines: not quite what the servos had.
    np.testing.assert_allclose(b.q, a.q, atol=2e-4)
    assert np.abs(a.q[-1] - [0.3, 0.2, -0.2, 0.1, 0.1, 0.1]).max() < 0.02


def test_water_in_the_model_file_is_simulated(root: Path, tmp_path: Path) -> None:
    """The forearm in water: the motors of joints 2 and 3 give more while it moves, and the weight is less at rest."""
    (tmp_path / "move.toml").write_text(EXPERIMENT)
    table = tomllib.loads((root / "config/models/puma560.toml").read_text())
    body = {"start": [0.0, 0.0, 0.0], "end": [0.0, 0.0, 0.4], "radius": 0.05}
    table["joint"][2]["cylinder"] = body | {"drag_coefficient": 1.0, "added_mass_coefficient": 1.0, "buoyancy": 1.0}
    (tmp_path / "wet.toml").write_text(tomli_w.dumps(table))
    runs = []
    for name, model in (("dry", root / "config/models/puma560.toml"), ("wet", tmp_path / "wet.toml")):
        out = tmp_path / f"{name}.mcap"
        arguments = ["--experiment", str(tmp_path / "move.toml"), "--out", str(out)]
        assert run(["simulate", "--model", str(model), *arguments]) == 0
        runs.append(open_recording(out))
    dry, wet = runs
    assert np.abs(wet.i[0, 1:3]).sum() < np.abs(dry.i[0, 1:3]).sum()
    moved = (wet.i - wet.i[0]) - (dry.i - dry.i[0])
    assert (np.abs(moved[:, :3]).max(axis=0) > 0.01).all()


def test_emps_is_simulated_as_published(root: Path, shared: Path, tmp_path: Path) -> None:
    """Janot, Gautier, Brunot 2019: relative errors of the simulated position 0.0138 %, force 5.85 %."""
    measured, simulated = tmp_path / "emps.mcap", tmp_path / "simulated.mcap"
    table = str(shared / "data/emps/train.csv")
    assert run(["import", table, "--rig", str(root / "config/emps.toml"), "--out", str(measured)]) == 0
    model = str(root / "config/models/emps.toml")
    assert run(["simulate", "--model", model, "--like", str(measured), "--out", str(simulated)]) == 0
    a, b = open_recording(measured), open_recording(simulated)
    assert np.linalg.norm(a.q - b.q) < 0.000138 * np.linalg.norm(a.q)
    assert np.linalg.norm(a.i - b.i) < 0.0585 * np.linalg.norm(a.i)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "simulate: needs either --experiment or --like"),
        (["--experiment", "{move}", "--target", "1,2"], "--target: must be three numbers X,Y,Z"),
        (["--experiment", "{move}", "--rate", "0"], "--rate: must be between 0.001 and 1e7 rows/s"),
        (["--experiment", "{move}", "--rate", "-5"], "--rate: must be between"),
        (["--experiment", "{move}", "--rate", "1e7"], "s are simulated at once"),
        (["--like", "{absent}"], "absent.mcap"),
    ],
)
def test_refuses_in_one_line(
    root: Path, tmp_path: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "move.toml").write_text(EXPERIMENT)
    places = {"move": str(tmp_path / "move.toml"), "absent": str(tmp_path / "absent.mcap")}
    arguments = [option.format(**places) for option in options]
    model = str(root / "config/models/puma560.toml")
    assert run(["simulate", "--model", model, "--out", str(tmp_path / "out.mcap"), *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "out.mcap").exists()
