"""From the simulated rig to corrected targets, as a person does it: plan, record, calibrate, command, measure."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import write_model
from armscope.cli import run
from daq.recording import open_recording
from experiment import read_experiment

sys.path.insert(0, str(Path(__file__).parent))
from arms import TARGET, puma, seen, with_errors

from identification.kinematics.data.recordings import tracked
from identification.kinematics.use.iso_cube import standstills
from tests.ports import free_endpoint


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_rig_with_a_wrong_model_is_calibrated_and_corrected(root: Path, tmp_path: Path) -> None:
    """The arm that moves has errors of its own.

    Encoders count, the tracker streams every third point and its noise is 0.06 mm.
    """
    nominal = puma(root)
    write_model(tmp_path / "true.toml", with_errors(nominal, np.random.default_rng(77)))
    text = (root / "config/puma560_sim.toml").read_text()
    text = text.replace('"puma560_sim"', f'"{tmp_path.name}-{os.getpid()}"', 1)
    text = text.replace('model = "models/', f'model = "{root}/config/models/', 1)
    text = text.replace('pace = "wall"', f'pace = "fast"\nmodel = "{tmp_path}/true.toml"')
    rig = tmp_path / "rig.toml"
    rig.write_text(f'{text}\n[zenoh]\nendpoint = "{free_endpoint()}"\n')

    def record(experiment: Path, name: str) -> str:
        out = tmp_path / f"{name}.mcap"
        assert run(["record", "--rig", str(rig), "--experiment", str(experiment), "--out", str(out)]) == 0
        return str(out)

    model, out = str(root / "config/models/puma560.toml"), tmp_path / "out"
    sweeps = [record(root / f"config/experiments/slow_sweep_{j}.toml", f"sweep{j}") for j in (2, 3)]
    fitted = record(root / "config/experiments/excitation.toml", "fit")
    judge = record(root / "config/experiments/excitation_held_out.toml", "judge")
    assert run(["calibrate", fitted, *sweeps, "--held-out", judge, "--model", model, "--out", str(out), "--cube"]) == 0
    table = json.loads((out / "kinematics.json").read_text())
    assert table["identifiable"] == 27
    assert [c["joint"] for c in table["circles"]] == [3, 2]
    assert table["improvement"]["held_out"] > 0.97
    # a tracker of 0.1 mm rms in space, and counters that are set anew at every start
    assert table["floor"]["points"] < 1.05 * 1e-4 / np.sqrt(3)
    assert table["position_rms"]["held_out"]["after"] < 1.1 * 1e-4 / np.sqrt(3) * np.sqrt(1 + 27 / 10000)

    planned = seen(nominal, stops_of(out / "iso_cube.toml"), TARGET)
    misses = {}
    for name in ("iso_cube", "iso_cube_corrected"):
        misses[name] = miss(Path(record(out / f"{name}.toml", name)), stops_of(out / f"{name}.toml"), planned, nominal)
    assert misses["iso_cube_corrected"].mean() < 0.05 * misses["iso_cube"].mean()


def stops_of(experiment: Path) -> np.ndarray:
    """(5, joints) rad: the commanded targets P1 .. P5."""
    read = read_experiment(experiment)
    return np.array([read.start] + [s.to for s in read.segment if s.type == "move"])[:5]


def miss(recording: Path, commanded: np.ndarray, planned: np.ndarray, nominal) -> np.ndarray:
    """(5,) m from the planned points, without the servos' own share.

    They stop a milliradian or two short in friction.
    """
    run = tracked(open_recording(recording)).run
    halves = [slice((a + b) // 2, b) for a, b in standstills(run)][:5]
    at = np.array([np.nanmedian(run.xyz[h], axis=0) for h in halves])
    reached = np.array([np.median(run.q[h], axis=0) for h in halves])
    servo = seen(nominal, reached, TARGET) - seen(nominal, commanded, TARGET)
    return np.linalg.norm(at - planned - servo, axis=1)
