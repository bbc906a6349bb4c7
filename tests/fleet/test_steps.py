"""Steps of a plan other than those of ``test_fleet``: models of the arms' own baselines, and calibration."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_fleet import Plan, Scene, Task, arm_nights, read_plan, write_fleet
from arm_fleet.simulation.wear import KINDS, Life
from arm_model import Arm, read_model
from arm_model.rigid_body.kinematics import link_frames
from armscope.api import fleet_night
from armscope.api.fleet import tasks_of
from daq.recording import Attachments, write_table

GAP, SEAL, TRANSDUCER = KINDS


def ran(task: Task, folder: Path, before: dict[str, bytes]) -> tuple[dict, dict[str, bytes]]:
    """What a task returns, and its files; without Dask, and in this process."""
    folder.mkdir()
    function = getattr(fleet_night, task.call.partition(":")[2])
    value = function(task.arguments | task.places, folder, before)
    return value, {path.name: path.read_bytes() for path in folder.iterdir()}


def planned(folder: Path, arm: Arm, **more: object) -> tuple[Plan, list[Task]]:
    """The tasks of the one arm ``a``."""
    plan = read_plan(folder / "plan.toml").model_copy(update=more)
    return plan, tasks_of(plan, arm_nights(plan), {"a": arm})["a"]


@pytest.mark.slow
def test_an_arm_is_judged_against_its_own_baseline(root: Path, tmp_path: Path) -> None:
    """Its friction is other than the nominal one all the time: no cause of a night against what its baseline shows."""
    nominal = read_model(root / "config/models/two_link.toml")
    own = replace(SEAL, growth=0.5).term(0.5)
    scene = Scene(arm=replace(nominal, effects=(*nominal.effects, own)), seconds=10.0)
    write_fleet(tmp_path, scene, [Life(arm="a", wear=replace(TRANSDUCER, growth=0.05), begins=1)], 3, seed=3)
    baseline = ("2026-01-01", "2026-01-02")
    _, (before, *nights) = planned(tmp_path, nominal, adapt=True, baseline=baseline, report="none")
    assert before.night == "" and len(before.arguments["recordings"]) == 4
    assert [one.after for one in nights] == [before.key] * 3
    _, files = ran(before, tmp_path / "baseline", {})
    assert set(files) >= {"identification.json", "model.toml"}
    healthy, worn = (ran(one, tmp_path / one.night, files)[0] for one in nights[1:])
    assert (healthy["verdict"], healthy["causes"]) == ("consistent", [])
    assert [(one["effect"], one["joint"]) for one in worn["causes"]] == [("current_gain", 1)]
    _, (plain, *_) = planned(tmp_path, nominal, baseline=baseline, report="none")
    assert plain.after is None and plain.key not in {one.key for one in nights}
    found, _ = ran(plain, tmp_path / "plain", {})
    assert ("coulomb_friction", 2) in [(one["effect"], one["joint"]) for one in found["causes"]]


@pytest.mark.slow
def test_a_plan_that_calibrates(root: Path, tmp_path: Path) -> None:
    """60 poses of an arm whose second encoder is off by 5 mrad, read whole however long they last."""
    arm = read_model(root / "config/models/puma560.toml")
    draw = np.random.default_rng(1)
    offset = np.array([0.0, 0.005, 0.0, 0.0, 0.0, 0.0])
    for run in (1, 2):
        q = draw.uniform(-1.5, 1.5, (60, 6))
        ends = link_frames(arm, arm.link_angles(q + offset))[:, -1]
        xyz = ends[:, :3, :3] @ np.array([0.05, 0.02, 0.1]) + ends[:, :3, 3] + 3e-5 * draw.normal(size=(60, 3))
        rig = 'name = "foreign"\n' + "[[joint]]\n" * 6 + "[tracker]\n"
        (tmp_path / "2026-01-01").mkdir(exist_ok=True)
        columns = {"q": q, "i": 0 * q, "xyz": xyz}
        write_table(tmp_path / f"2026-01-01/a_{run}.mcap", np.arange(60) * 10.0, columns, Attachments(rig=rig))
    (tmp_path / "plan.toml").write_text(
        'model = "m.toml"\nrecordings = "{night}/{arm}_*.mcap"\nrun = ["calibrate"]\n[[arm]]\nname = "a"\n'
    )
    _, (task,) = planned(tmp_path, arm)
    value, files = ran(task, tmp_path / "out", {})
    assert value["rows"] == 120 and value["bytes"] == value["read_bytes"]
    table = json.loads(files["kinematics.json"])
    assert value["position_rms"] == table["position_rms"]
    assert value["position_rms"]["fit"]["after"] < 5e-5 < 1e-3 < value["position_rms"]["fit"]["before"]
