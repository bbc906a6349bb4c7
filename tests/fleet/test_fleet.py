"""A simulated fleet from its wear to the verdict: the night of the first name against that when wear became visible."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_fleet import Scene, lives, write_fleet
from arm_fleet.simulation.recordings import night_of
from arm_fleet.simulation.wear import KINDS, Life
from arm_io import InputError
from arm_model import read_model
from armscope.api.fleet_night import night
from armscope.cli import run
from daq.recording import open_recording

GAP, SEAL, TRANSDUCER = KINDS


@pytest.fixture
def scene(root: Path) -> Scene:
    return Scene(arm=read_model(root / "config/models/two_link.toml"), seconds=10.0)


def test_the_truth_is_what_is_recorded(scene: Scene, tmp_path: Path) -> None:
    """A transducer that shows 20 % too much, and after the repair what it showed before."""
    drifting = replace(TRANSDUCER, growth=0.1)
    fleet = [Life(arm="a", wear=drifting, begins=0, repaired=3), Life(arm="b")]
    truth = write_fleet(tmp_path, replace(scene, runs=1, seconds=4.0), fleet, 4, seed=3)
    assert json.loads((tmp_path / "truth.json").read_text()) == truth
    worn, healthy = truth["arms"]
    assert worn["values"] == [0.0, 0.1, 0.2, 0.0] and worn["repaired"] == "2026-01-04"
    assert healthy["ratios"] == [0.0] * 4 and worn["visible"] == "2026-01-02"

    def current(arm: str, number: int) -> np.ndarray:
        return open_recording(tmp_path / f"nights/{night_of(number)}/{arm}_1.mcap").i[:, 0]

    still = current("b", 2)
    for number, factor in ((0, 1.0), (2, 1.2), (3, 1.0)):
        measured = current("a", number)
        assert np.vdot(still, measured) / np.vdot(still, still) == pytest.approx(factor, abs=0.01)
    size = np.sqrt(np.mean((current("a", 2) - still) ** 2)) / truth["noise"]
    assert size == pytest.approx(np.hypot(worn["ratios"][2], np.sqrt(2)), rel=0.1)


def test_a_gap_of_nearly_nothing_changes_nearly_nothing(scene: Scene, tmp_path: Path) -> None:
    """Against the same gear without a gap, whose teeth are as flexible; a rigid one differs by 2.3 times the noise."""
    life = Life(arm="a", wear=replace(GAP, growth=1e-7), begins=0)
    (worn,) = write_fleet(tmp_path, replace(scene, runs=1, seconds=4.0), [life], 3, seed=3)["arms"]
    assert 0.0 == worn["ratios"][0] < worn["ratios"][1] < worn["ratios"][2] < 0.1


def test_nights_of_another_temperature(scene: Scene, tmp_path: Path) -> None:
    """Recorded, with friction that follows it; wear counts alone; noise that forgets itself in 0.02 s."""
    fleet = [Life(arm="a", wear=replace(TRANSDUCER, growth=0.1), begins=0), Life(arm="b")]
    changing = replace(scene, runs=1, seconds=8.0, temperature=10.0, correlation=0.02)
    truth = write_fleet(tmp_path, changing, fleet, 3, seed=3)
    assert truth["arms"][1]["ratios"] == [0.0] * 3 and truth["arms"][0]["ratios"][2] > 10
    nights = [open_recording(tmp_path / f"nights/{night_of(k)}/b_1.mcap") for k in range(3)]
    cold, warm = sorted(nights, key=lambda one: one.temp[0, 0])[:: len(nights) - 1]
    assert warm.temp[0, 0] > cold.temp[0, 0] + 5
    moving = np.abs(cold.i[:, 0]) > 1.0
    assert np.mean(np.abs(warm.i[moving, 0])) < 0.97 * np.mean(np.abs(cold.i[moving, 0]))
    write_fleet(tmp_path / "alike", replace(changing, temperature=0.0), [Life(arm="b"), Life(arm="c")], 1, seed=3)
    one, other = (open_recording(tmp_path / f"alike/nights/{night_of(0)}/{arm}_1.mcap") for arm in "bc")
    noise = (one.i - other.i)[:, 0] / truth["noise"]
    assert one.temp is None and noise.std() == pytest.approx(np.sqrt(2), rel=0.1)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(np.exp(-1 / 5), abs=0.05)


def test_a_season(tmp_path: Path) -> None:
    """``--season`` alone: every arm is so many kelvin warmer in the last night, and turns more easily."""
    arguments = ["fleet-sim", str(tmp_path / "fleet"), "--arms", "1", "--nights", "2", "--worn", "0", "--seconds", "4"]
    assert run([*arguments, "--season", "12"]) == 0
    first, last = (open_recording(tmp_path / f"fleet/nights/{night_of(k)}/arm-001_1.mcap") for k in (0, 1))
    assert first.temp is not None and last.temp is not None
    assert np.median(last.temp) - np.median(first.temp) == pytest.approx(12.0, abs=0.5)
    moving = np.abs(first.i[:, 0]) > 1.0
    assert np.mean(np.abs(last.i[moving, 0])) < 0.97 * np.mean(np.abs(first.i[moving, 0]))


def test_an_arm_without_controller_is_refused(scene: Scene, tmp_path: Path) -> None:
    bare = replace(scene, arm=replace(scene.arm, controller=None))
    with pytest.raises(InputError, match=r"Two links: has no \[controller\]"):
        write_fleet(tmp_path / "fleet", bare, [Life(arm="a")], 1, seed=1)
    assert not (tmp_path / "fleet").exists()


def test_lives_are_drawn_as_asked() -> None:
    fleet = lives(40, 30, worn=0.5, seed=1)
    worn = [life for life in fleet if life.wear is not None]
    assert len(fleet) == 40 and len(worn) == 20 and {life.wear for life in worn} == set(KINDS)
    assert all(life.begins >= 5 and not life.values(30)[: life.begins + 1].any() for life in worn)
    assert sum(life.repaired is not None for life in worn) == 10
    assert fleet == lives(40, 30, worn=0.5, seed=1) != lives(40, 30, worn=0.5, seed=2)


def test_one_night(scene: Scene, tmp_path: Path) -> None:
    """What a task computes, without Dask: friction that grew is named; a wrong calibration is refused."""
    write_fleet(tmp_path, scene, [Life(arm="a", wear=replace(SEAL, growth=0.5))], 2, seed=3)
    job: dict[str, Any] = {
        "name": "a",
        "model": (tmp_path / "model.toml").read_text(),
        "places": sorted(str(path) for path in (tmp_path / "nights/2026-01-02").iterdir()),
        "storage": {},
        "run": ["identify", "diagnose"],
        "report": "none",
        "seconds": 180.0,
        "rig": None,
        "calibration": None,
    }
    out = tmp_path / "out"
    out.mkdir()
    value = night(job, out, {})
    assert [(cause["effect"], cause["joint"]) for cause in value["causes"]] == [("coulomb_friction", 2)]
    assert value["recorded"] == "2026-01-02T22:00:00Z" and value["lost"] == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "diagnosis.json",
        "identification.json",
        "model.toml",
        "model_uncertainty.json",
    ]
    with pytest.raises(InputError, match=r"a_1\.mcap: has calibration 'none'; the plan says 'abc'"):
        night(job | {"calibration": "abc"}, out, {})


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_a_fleet_that_wears(scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Named at the latest two nights after wear became visible; healthy arms and repaired ones are silent."""
    fleet = [
        Life(arm="gap", wear=GAP, begins=5),
        Life(arm="seal", wear=replace(SEAL, growth=0.2), begins=5, repaired=9),
        Life(arm="healthy"),
    ]
    truth = {one["arm"]: one for one in write_fleet(tmp_path, scene, fleet, 12, seed=3)["arms"]}
    plan = tmp_path / "plan.toml"
    plan.write_text(plan.read_text().replace("timeout", 'report = "none"\ntimeout', 1))
    out = tmp_path / "out"
    arguments = ["fleet", str(plan), "--out", str(out), "--workers", "2", "--json"]
    assert run(arguments) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["ran"] == 36 and table["failed"] == 0
    arms = {one["arm"]: one for one in table["arms"]}
    assert arms["healthy"]["condition"] == "no change" and arms["healthy"]["since"] is None
    for name, cause in (("gap", "backlash of joint 1"), ("seal", "Coulomb friction of joint 2")):
        visible = truth[name]["visible"]
        latest = np.datetime64(visible) + np.timedelta64(2, "D")
        assert truth[name]["begins"] <= arms[name]["since"] <= str(latest)
        assert arms[name]["cause"] == cause
    assert arms["gap"]["condition"] == "changed"
    assert arms["seal"]["condition"] == "changed, and is as before again"
    assert arms["seal"]["until"] < truth["seal"]["repaired"]
    assert run(arguments) == 0
    assert json.loads(capsys.readouterr().out)["ran"] == 0
