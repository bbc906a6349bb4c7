"""What is written is what was printed: model.toml, read back, predicts with the error that leads the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import Arm, EffectTerm, Joint, read_model, with_parameters, write_model
from arm_model.effects.dissipation import dissipative, driven, least_friction, total_friction
from armscope.cli import run
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table

SPEED = 0.4  # m/s, the highest of the motions below
LESS = EffectTerm("stribeck_friction", 1, {"breakaway": -6.0, "stribeck_velocity": 0.03})


def carriage(*effects: EffectTerm) -> Arm:
    """A carriage of 20 kg with 10 N of Coulomb friction, along a level rail."""
    joint = Joint(type="prismatic", mass=20.0, coulomb=10.0, viscous=30.0, sign_velocity=1e-4)
    return Arm(name="carriage", joints=(joint,), gravity=(0.0, -9.80665, 0.0), effects=effects)


def record(path: Path, arm: Arm, seed: int) -> Path:
    """40 s of strokes at many speeds; force by hand: m a, friction with less of it at low speed, noise."""
    random = np.random.default_rng(seed)
    t = np.arange(0, 40.0, 2e-3)
    f = 0.1 * np.arange(1, 8)
    a, phase = random.normal(size=7) / f, random.uniform(0, 2 * np.pi, 7)
    wave = 2 * np.pi * f * t[:, None] + phase
    scale = SPEED / np.abs(-np.sin(wave) @ (a * 2 * np.pi * f)).max()
    q, v = scale * np.cos(wave) @ a, -scale * np.sin(wave) @ (a * 2 * np.pi * f)
    force = arm.joints[0].mass * -scale * np.cos(wave) @ (a * (2 * np.pi * f) ** 2)
    force += np.sign(v) * (10.0 - 6.0 * np.exp(-((v / 0.03) ** 2))) + 30.0 * v
    i = force + 0.05 * random.standard_normal(len(t))
    write_table(path, t, {"q": np.round(q / 1e-7)[:, None] * 1e-7, "i": i[:, None]}, Attachments())
    return path


def relative_error(recordings: list[Path], model: Path) -> float:
    """Of the model file, as anybody would take it: over all rows of all recordings."""
    found = armscope.predict(recordings, model)
    residual, measured = (np.concatenate(part) for part in zip(*((p.residual, p.measured) for p in found)))
    return float(np.linalg.norm(residual) / np.linalg.norm(measured))


def test_friction_below_coulombs_is_written_as_found(tmp_path: Path) -> None:
    arm = carriage(replace(LESS, parameters={"breakaway": -4.0, "stribeck_velocity": 0.03}))
    fit, held = (record(tmp_path / f"{seed}.mcap", arm, seed) for seed in (1, 2))
    write_model(tmp_path / "model.toml", with_parameters(arm, {"link1.mass": 15.0, "joint1.coulomb": 8.0}))
    result = armscope.identify(fit, tmp_path / "model.toml", held_out=held)
    table = result.write(tmp_path / "out")
    written = read_model(tmp_path / "out/model.toml")
    assert written.effects[0].parameters["breakaway"] == pytest.approx(-6.0, rel=0.05)
    assert written.joints[0].coulomb[0] == pytest.approx(10.0, rel=0.02)
    assert relative_error([held], tmp_path / "out/model.toml") == pytest.approx(
        table["relative_error"]["held_out"], rel=1e-6
    )
    assert relative_error([fit], tmp_path / "out/model.toml") == pytest.approx(table["relative_error"]["fit"], rel=1e-6)
    # nothing was given away on the way to an arm that could exist
    alone = table["compared"]["least squares alone, not physically consistent"]["held_out"]
    assert table["relative_error"]["held_out"] < 1.02 * alone


def test_impossible_values_are_not_the_ones_that_are_judged(tmp_path: Path) -> None:
    """Currents with a spring that the model lacks: least squares makes a mass that no body has; the file does not."""
    arm = carriage()
    fit, held = (record(tmp_path / f"{seed}.mcap", arm, seed) for seed in (1, 2))
    for path, seed in ((fit, 1), (held, 2)):
        read = armscope.open(path)
        write_table(
            tmp_path / f"spring{seed}.mcap", read.t, {"q": read.q, "i": read.i + 1500.0 * read.q}, Attachments()
        )
    result = armscope.identify(tmp_path / "spring1.mcap", arm, held_out=tmp_path / "spring2.mcap")
    table = result.write(tmp_path / "out")
    mass = next(p for p in table["parameters"] if p["name"] == "link1.mass")
    assert mass["value"] < 0 < read_model(tmp_path / "out/model.toml").joints[0].mass
    printed = table["relative_error"]["held_out"]
    assert relative_error([tmp_path / "spring2.mcap"], tmp_path / "out/model.toml") == pytest.approx(printed, rel=1e-6)
    assert printed > 1.1 * table["compared"]["least squares alone, not physically consistent"]["held_out"]


def test_one_set_of_friction_for_files_and_commands(tmp_path: Path) -> None:
    possible, impossible = carriage(LESS), carriage(replace(LESS, parameters={**LESS.parameters, "breakaway": -13.0}))
    assert driven(possible) == [] and driven(impossible) == [0]
    v, torque = least_friction(impossible, 0)
    assert abs(v) < 0.01 and torque == pytest.approx(-3.0, abs=0.05)
    write_model(tmp_path / "possible.toml", possible)
    write_model(tmp_path / "impossible.toml", impossible)
    assert read_model(tmp_path / "possible.toml") == possible
    with pytest.raises(InputError, match=r"joint\[1\].*drives it with 3 N at"):
        read_model(tmp_path / "impossible.toml")
    mended = dissipative(impossible)
    assert driven(mended) == []
    speeds = np.linspace(0, 0.09, 50)
    assert total_friction(mended, 0, speeds, -1).min() == pytest.approx(0.0, abs=1e-3)
    assert mended.joints[0].coulomb[0] - 10.0 == pytest.approx(3.0, abs=0.5)
    # at high speed alone: what falls with the speed, up to the highest
    falling = replace(carriage(), joints=(replace(carriage().joints[0], viscous=-30.0),))
    assert driven(falling, [0.3]) == [] and driven(falling, [0.5]) == [0]
    assert driven(dissipative(falling, [0.5]), [0.5]) == []
    # at the start it opposes the motion; when its change has ended it would drive
    terms = {"coulomb": -2.0, "change": -0.5, "until": 20.0}
    fading = replace(carriage(), effects=(EffectTerm("coulomb_friction", 1, terms),))
    assert driven(fading) == [0] and driven(dissipative(fading)) == []
    assert driven(replace(fading, effects=(replace(fading.effects[0], parameters={**terms, "until": 10.0}),))) == []


@pytest.mark.parametrize("rate", [4, 10, 16])
def test_slow_recordings_end_in_one_line_or_a_result(
    rate: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    read = armscope.open(record(tmp_path / "fast.mcap", carriage(), 1))
    rows = slice(None, None, 500 // rate)
    write_table(tmp_path / "slow.mcap", read.t[rows], {"q": read.q[rows], "i": read.i[rows]}, Attachments())
    write_model(tmp_path / "model.toml", carriage())
    slow, model = str(tmp_path / "slow.mcap"), str(tmp_path / "model.toml")
    # the check says what both commands do
    ready = run(["identify", slow, "--model", model, "--check", "--json"])
    printed = capsys.readouterr()
    assert run(["identify", slow, "--model", model, "--out", str(tmp_path / "out")]) == ready
    if ready == 2:
        assert capsys.readouterr().err == printed.err
    foretold = json.loads(printed.out) if ready == 0 else None
    capsys.readouterr()
    assert run(["diagnose", "--fit", slow, "--model", model, "--out", str(tmp_path / "found")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and "rows per second; at least 20 are needed" in said and said.count("\n") == 1
    assert not (tmp_path / "found" / "diagnosis.json").exists()
    if foretold is not None:
        assert said == f"error: {foretold['refused_by_diagnose']}\n"
        assert f"refused by 'armscope diagnose': {foretold['refused_by_diagnose']}" in foretold["sentence"]


def test_published_drive(root: Path, shared: Path, tmp_path: Path) -> None:
    """EMPS: the Stribeck term that a diagnosis finds survives an identification, and so does its error."""
    runs = {}
    for name in ("train", "pulses"):
        runs[name] = tmp_path / f"{name}.mcap"
        table = shared / f"data/emps/{name}.csv"
        assert run(["import", str(table), "--rig", str(root / "config/emps.toml"), "--out", str(runs[name])]) == 0
    effects = (
        EffectTerm("time_skew", None, {"delay": -0.0008}),
        EffectTerm("stribeck_friction", 1, {"breakaway": -9.7, "stribeck_velocity": 0.0116}),
    )
    write_model(tmp_path / "model.toml", replace(read_model(root / "config/models/emps.toml"), effects=effects))
    options = ["--model", str(tmp_path / "model.toml"), "--held-out", str(runs["pulses"]), "--friction", "asymmetric"]
    assert run(["identify", str(runs["train"]), *options, "--out", str(tmp_path / "out")]) == 0
    table = json.loads((tmp_path / "out/identification.json").read_text())
    printed, noise = table["relative_error"]["held_out"], table["joints"][0]["noise"]
    # the most that anybody explained of this drive, and yet no noise, of which a demanded voltage has little
    assert noise["ratio"] > 5 and noise["unit"] == "V"
    assert "Not validated" in (tmp_path / "out/report.html").read_text()
    assert read_model(tmp_path / "out/model.toml").effects[1].parameters["breakaway"] < -8.0
    assert printed < 0.03
    assert relative_error([runs["pulses"]], tmp_path / "out/model.toml") == pytest.approx(printed, rel=1e-6)
