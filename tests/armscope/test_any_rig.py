"""The shipped rigs of a SCARA, a gantry, a cylindrical and a URDF arm, from the outside, as docs/own-rig.md has it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arm_model import EffectTerm, read_model, write_model
from armscope.cli import run
from experiment import read_experiment
from tests.sim_backend.recordings import record

MODELS = {
    "scara": "scara_driven.toml",
    "gantry": "gantry.toml",
    "cylindrical": "cylindrical.toml",
    "ur5e": "ur5e.urdf",
}
HIDDEN = {
    "scara": EffectTerm("cogging", 3, {"amplitude": 2.0, "pole_pairs": 4.0, "phase": 0.5}),
    "gantry": EffectTerm("backlash", 2, {"half_gap": 4e-4}),
    "cylindrical": EffectTerm("encoder_ripple", 3, {"amplitude": 2e-4, "order": 1.0, "phase": 0.4}),
}
MISBUILT: dict[str, dict[int, dict[str, Any]]] = {
    "scara": {1: {"a": 0.327}, 2: {"theta": 0.003}},
    "gantry": {2: {"rpy": (0.002, 0.003, 0.0)}},
    "cylindrical": {4: {"xyz": (0.1215, 0.001, 0.0)}},
}
"""Errors of geometry by joint from 1: a longer link and a zero off, an axis that tilts, a joint beside its place."""
UNITS = {"amplitude": {"scara": "N", "cylindrical": "m"}, "half_gap": {"gantry": "m"}}


def recorded(root: Path, arm: str, folder: Path, **simulation: object) -> list[str]:
    folder.mkdir()
    motions = [read_experiment(root / f"config/experiments/arms/{arm}_{part}.toml") for part in ("fit", "held_out")]
    return [str(path) for path in record(root / f"config/{arm}_sim.toml", motions, folder, **simulation)]


@pytest.mark.slow
@pytest.mark.parametrize("arm", list(MODELS))
def test_a_healthy_arm_is_identified_and_calibrated_to_the_noise(root: Path, tmp_path: Path, arm: str) -> None:
    model = root / "config/models" / MODELS[arm]
    fit, held_out = recorded(root, arm, tmp_path / "runs")
    assert run(["identify", fit, "--held-out", held_out, "--model", str(model), "--out", str(tmp_path / "id")]) == 0
    found = json.loads((tmp_path / "id/identification.json").read_text())
    assert found["relative_error"]["held_out"] < 0.002
    known = read_model(model)
    values = {one["name"]: one for one in found["parameters"]}
    for number, joint in enumerate(known.joints, 1):
        viscous = values[f"joint{number}.viscous"]
        assert viscous["unit"] == ("N m s/rad" if joint.revolute else "N s/m")
        assert viscous["value"] == pytest.approx(joint.ratio**2 * joint.viscous[0], abs=4 * viscous["std"] + 1e-3)
    assert run(["calibrate", fit, held_out, "--model", str(model), "--out", str(tmp_path / "kin")]) == 0
    rms = json.loads((tmp_path / "kin/kinematics.json").read_text())["position_rms"]["held_out"]
    assert rms["after"] == pytest.approx(rms["before"], rel=0.01) and rms["after"] < 1.1e-4


@pytest.mark.slow
@pytest.mark.parametrize("arm", list(MISBUILT))
def test_a_misbuilt_arm_is_calibrated_to_the_noise(root: Path, tmp_path: Path, arm: str) -> None:
    """Held-out points, which were off by more than the noise, come down to it; the length of a link is found."""
    model = root / "config/models" / MODELS[arm]
    known = read_model(model)
    joints = [replace(joint, **MISBUILT[arm].get(number, {})) for number, joint in enumerate(known.joints, 1)]
    write_model(tmp_path / "worn.toml", replace(known, joints=tuple(joints)))
    fit, held_out = recorded(root, arm, tmp_path / "runs", model=str(tmp_path / "worn.toml"))
    options = ["--held-out", held_out, "--model", str(model), "--out", str(tmp_path / "kin")]
    assert run(["calibrate", fit, *options]) == 0
    found = json.loads((tmp_path / "kin/kinematics.json").read_text())
    rms = found["position_rms"]["held_out"]
    assert rms["before"] > 1.2e-4
    assert rms["after"] < 6.5e-5, "0.1 mm over three coordinates are 0.058 mm"
    if arm == "scara":
        (first,) = (one for one in found["parameters"] if one["joint"] == 1)
        assert first["a"] == pytest.approx(0.327, abs=4 * first["std"]["a"])
        assert first["std"]["a"] < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("arm", list(HIDDEN))
def test_what_was_hidden_is_named_in_its_units(root: Path, tmp_path: Path, arm: str) -> None:
    known, hidden = root / "config/models" / MODELS[arm], HIDDEN[arm]
    write_model(tmp_path / "worn.toml", replace(read_model(known), effects=(hidden,)))
    fit, held_out = recorded(root, arm, tmp_path / "runs", model=str(tmp_path / "worn.toml"))
    options = ["--fit", fit, "--held-out", held_out, "--out", str(tmp_path / "out")]
    assert run(["diagnose", "--model", str(known), *options]) == 0
    (cause,) = json.loads((tmp_path / "out/diagnosis.json").read_text())["causes"]
    assert (hidden.name, hidden.joint) in {(one["effect"], one["joint"]) for one in cause["group"]}
    for name, units in UNITS.items():
        if name in hidden.parameters:
            size = cause["parameters"][name]
            assert size["unit"] == units[arm]
            assert size["value"] == pytest.approx(hidden.parameters[name], abs=4 * size["std"])
