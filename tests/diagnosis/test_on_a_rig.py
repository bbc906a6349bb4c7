"""``armscope diagnose --rig``: a group of the given recordings is decided by an experiment on the rig.

Nothing real moves unasked.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from arm_io import read_toml, write_toml
from arm_model.description import EffectTerm
from arm_model.model_file import read_model, write_model
from armscope import adaptive_diagnosis
from armscope.adaptive_diagnosis import Bench, Case, go_on, limits_of
from daq.recording import open_recording
from daq.rig.rig_file import read_rig
from diagnosis.experiments.discriminating import Separation
from diagnosis.experiments.motions import Kind, Stage, room, trials
from diagnosis.result import Diagnosis
from tests.diagnosis.runs import group_of, seen
from tests.sim_backend.recordings import record

ASYMMETRY = EffectTerm("friction_asymmetry", 1, {"positive": 4.0, "negative": -4.0})


def _rig(root: Path, folder: Path, **simulation: object) -> Path:
    """A simulated Puma that hides an asymmetry, on an endpoint and under a name of its own."""
    arm = read_model(root / "config/models/puma560.toml")
    write_model(folder / "hidden.toml", replace(arm, effects=(ASYMMETRY,)))
    table: dict[str, Any] = read_toml(root / "config/puma560_sim.toml")
    table["name"] = f"separating_{os.getpid()}"
    table["model"] = str(root / "config/models/puma560.toml")
    table["block_seconds"] = 0.2
    table["zenoh"] = {"endpoint": f"tcp/127.0.0.1:{20000 + os.getpid() % 20000}"}
    table["simulation"] |= {"model": str(folder / "hidden.toml"), "pace": "fast", **simulation}
    write_toml(folder / "rig.toml", table)
    return folder / "rig.toml"


def _diagnose(rig: Path, folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    recordings = ["--fit", str(folder / "fit/excitation.mcap"), "--held-out", str(folder / "held/excitation.mcap")]
    command = [
        sys.executable,
        "-m",
        "armscope",
        "diagnose",
        "--rig",
        str(rig),
        *recordings,
        "--out",
        str(folder / "out"),
    ]
    return subprocess.run([*command, "--json", *more], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def _given(root: Path, rig: Path, folder: Path) -> None:
    """The recordings that leave a group: always moving, but for their ends."""
    from experiment import read_experiment

    experiment = read_experiment(root / "config/experiments/excitation.toml")
    for side, seed in (("fit", 1), ("held", 2)):
        (folder / side).mkdir()
        record(rig, [experiment], folder / side, model=str(folder / "hidden.toml"), seed=seed)


def _is_a_report(path: Path, cause: str) -> None:
    """One file that needs no network.

    The verdict, the cause, what was not detectable, the unexplained structure, the simulation compared with the arm.
    """
    page = path.read_text()
    assert len(page) < 3e6 and "<script src" not in page and "<link" not in page
    assert re.findall(r'(?:src|href)="(?!data:|#)', page) == []
    headings = [
        'class="verdict"',
        '<h2 id="cause1"',
        "<h2>Not detectable in these recordings",
        "<h2>Unexplained structure",
        "<h2>The simulation before and after",
        "<h2>Joint by joint",
    ]
    places = [page.index(heading) for heading in headings]
    assert places == sorted(places)
    assert cause in page[places[0] : places[1]]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_an_experiment_decides_what_the_recordings_could_not(root: Path, tmp_path: Path) -> None:
    rig = _rig(root, tmp_path)
    _given(root, rig, tmp_path)
    undecided = _diagnose(rig, tmp_path, "--max-experiments", "0")
    assert undecided.returncode == 0, undecided.stderr
    before = json.loads(undecided.stdout)["causes"]
    assert {member["effect"] for member in before[0]["group"]} >= {"current_offset", "friction_asymmetry"}
    assert Path(before[0]["separate_by"]).is_file()
    decided = _diagnose(rig, tmp_path)
    assert decided.returncode == 0, decided.stderr
    assert "drives off" in decided.stderr  # shown before it ran
    table = json.loads(decided.stdout)
    assert [(cause["effect"], cause["joint"]) for cause in table["causes"]] == [("friction_asymmetry", 1)]
    assert table["causes"][0]["group"] == [{"effect": "friction_asymmetry", "joint": 1}]
    assert table["causes"][0]["parameters"]["positive"]["value"] == pytest.approx(4.0, rel=0.1)
    assert len(table["experiments"]) == 1 and len(table["fit"]) == len(table["held_out"]) == 2
    _is_a_report(tmp_path / "out/report.html", "friction asymmetry of joint 1")
    taken = open_recording(table["experiments"][0]["files"][0])
    assert taken.experiment is not None and taken.experiment["setup"]["drives_off"]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_fault_leaves_whole_results_of_what_was_known_before(root: Path, tmp_path: Path) -> None:
    rig = _rig(root, tmp_path)
    _given(root, rig, tmp_path)
    table = read_toml(rig)
    table["simulation"]["fault"] = [{"kind": "unplugged", "device": "counter1", "at": 2.0}]
    write_toml(rig, table)
    ended = _diagnose(rig, tmp_path)
    assert ended.returncode == 3 and ended.stderr.splitlines()[-1].startswith("error: ")
    known = json.loads((tmp_path / "out/diagnosis.json").read_text())
    assert known["causes"] and "experiments" not in known
    assert not [path.name for path in (tmp_path / "out").iterdir() if path.suffix in (".part", ".active")]


def test_a_real_arm_is_not_moved_unasked(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rig with other drivers than simulated ones is real: without --yes on a terminal nothing is recorded.

    The file then says what to record.
    """
    rig = read_rig(root / "config/puma560_can.toml", drivers=False)
    arm = read_model(root / "config/models/puma560.toml")
    data = replace(seen(root, arm, [ASYMMETRY]), causes=[group_of(("friction_asymmetry", 1), ("current_offset", 1))])
    stage = Stage(arm, data.fit[0].q[0], data.fit[0].q[:1], room(arm))
    chosen = next(iter(trials(stage, [1], Kind.OFF)))
    found = Separation(chosen.experiment, 100.0, chosen.words, 1)
    monkeypatch.setattr(adaptive_diagnosis, "separations", lambda *_: {0: found})
    kept: list[Case] = []
    said: list[str] = []

    def judge(fit: object, held_out: object) -> Diagnosis:
        raise AssertionError("nothing new to judge")

    for yes in (False, True):  # with the drives to be switched off by hand, --yes alone does not do either
        bench = Bench(root / "config/puma560_can.toml", rig, tmp_path, yes, said.append, judge, kept.append)
        assert not bench.simulated
        case = go_on(bench, Case([], [], cast(Diagnosis, data), {}), 3, lambda sentence: None)
        assert not case.experiments and kept[-1] is case
        assert "not run" in said[-1]
    assert "switch the drives off" in " ".join(said)
    assert not list(tmp_path.glob("*.mcap"))


def test_limits_of_the_rig_bound_what_is_asked_for(root: Path) -> None:
    rig = read_rig(root / "config/puma560_sim.toml", drivers=False)
    arm = read_model(root / "config/models/puma560.toml")
    limits = limits_of(rig, arm.joint_array("drive_constant"))
    assert rig.limits.speed is not None and rig.limits.current is not None
    assert list(limits.speed) == rig.limits.speed
    assert limits.torque[0] == pytest.approx(rig.limits.current[0] * arm.joints[0].drive_constant)
