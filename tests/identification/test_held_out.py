"""Whether a model carries over.

held-out motions that are livelier, stand and reverse more often than what was fitted.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.parameters import with_parameters
from arm_model.simulation.simulation import simulate_at
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from experiment import Experiment, demand_of
from identification.experiment_design import Series, design_excitation
from identification.report.html import report, verdict
from identification.result import Identification
from tests.arm_model.pumas import three_links

RATE = 14.4 / 0.028  # Hz, no multiple of the setpoints' rate
COUNTS = 1e-4  # rad, a step of the encoders


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return three_links(read_model(root / "config/models/puma560.toml"))


@pytest.fixture(scope="module")
def runs(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """An excitation; moves from stop to stop, by the same arm and by one whose forearm weighs 1 kg more."""
    folder = tmp_path_factory.mktemp("runs")
    excitation = design_excitation(arm, Series(16.0), candidates=160, seed=3)
    poses = [[0.9, -0.3, 0.9], [-0.6, 0.5, -0.2], [0.2, 1.2, -1.4], [0.0, 0.3, -0.8]]
    moves = [{"type": "move", "to": pose, "speed": 0.9} for pose in poses]
    limits = {"full_speed": [1.4, 1.2, 2.0], "full_acceleration": [8.0, 6.0, 12.0]}
    stops = Experiment.model_validate({"name": "stops", "start": [0.0, 0.3, -0.8], **limits, "segment": moves})
    heavier = with_parameters(arm, {"link3.mass": arm.joints[2].mass + 1.0})
    return {
        "fit": recorded(arm, excitation, folder / "fit.mcap", 0),
        "same": recorded(arm, stops, folder / "same.mcap", 1),
        "heavier": recorded(heavier, stops, folder / "heavier.mcap", 2),
    }


def recorded(arm: Arm, experiment: Experiment, path: Path, seed: int) -> Recording:
    random, demand = np.random.default_rng(seed), demand_of(experiment)
    t = np.arange(int(demand.duration * RATE) - 1) / RATE
    run = simulate_at(arm, demand, t)
    q = np.floor(run.qm / COUNTS + random.uniform(0, 1, len(arm))) * COUNTS
    write_table(path, t, {"q": q, "i": run.current + 0.01 * random.standard_normal(q.shape)}, Attachments())
    return open_recording(path)


def judged(runs: dict[str, Recording], arm: Arm, by: str) -> Identification:
    return armscope.identify(runs["fit"], arm, held_out=runs[by])


def test_true_model_carries_over_to_stops_and_reversals(arm: Arm, runs: dict[str, Recording]) -> None:
    result = judged(runs, arm, "same")
    assert result.joints_above_expected() == []
    assert "Validated on" in verdict(result)
    page = report(result).html()
    assert ">expected<" in page and ">noise floor<" in page
    assert result.noise is not None
    worst = max(result.noise, key=lambda one: one.ratio)
    assert 0.5 < worst.ratio < 2.5
    assert f"at most {worst.ratio:.2g} times the noise floor of the instruments (joint {worst.joint}" in verdict(result)
    # Around stops and reversals friction is not Coulomb's law: there the same model errs more, and is not blamed.
    assert result.relative_error(True) > 2 * result.relative_error(False)
    assert result.rms(True, 0) > 2 * result.rms(True, 0, sliding=True)


def test_what_is_not_in_the_model_is_named_by_joint(arm: Arm, runs: dict[str, Recording]) -> None:
    result = judged(runs, arm, "heavier")
    assert result.joints_above_expected() == [0, 1, 2]
    said = verdict(result)
    assert result.noise is not None and "Not validated" in said
    assert {1, 2} <= {one.joint for one in result.noise if one.above}
    for one in result.noise:
        assert one.above == (f"{one.ratio:.2g} times at joint {one.joint} (" in said)
    assert max(one.ratio for one in result.noise) > 10
    assert said.index(f"joint {max(result.noise, key=lambda one: one.ratio).joint} (") < 300
    sliding = result.to_json()["joints"][1]["sliding"]
    assert sliding["held_out"] > 20 * sliding["held_out_expected"] > 0


def test_both_commands_judge_a_model_by_one_yardstick(arm: Arm, runs: dict[str, Recording], tmp_path: Path) -> None:
    """What identify writes beside its model is what diagnose says of that model: neither refutes the other."""
    result = judged(runs, arm, "heavier")
    table = result.write(tmp_path)
    found = armscope.diagnose(runs["fit"], tmp_path / "model.toml", held_out=runs["heavier"])
    signals = {one["joint"]: one for one in found.to_json()["signals"] if one["signal"] == "current"}
    for joint in table["joints"]:
        own = joint["noise"]
        assert own["of"] == "held_out" and own["ratio"] == pytest.approx(own["error_rms"] / own["floor_rms"])
        assert own["ratio"] == pytest.approx(signals[joint["joint"]]["noise_ratio"]["before"], rel=1e-3)
    assert "over the noise floor of the instruments: joint 1" in str(found)


def test_missing_friction_is_no_validated_model(arm: Arm, runs: dict[str, Recording], tmp_path: Path) -> None:
    """Friction that grows with the load, in what is fitted and what is held out: the model has no term for it."""
    rubbing = arm.with_effect("load_friction", joint=2, mu=0.15)
    excitation = design_excitation(arm, Series(16.0), candidates=40, seed=3)
    fit = recorded(rubbing, excitation, tmp_path / "fit.mcap", 3)
    held = recorded(rubbing, design_excitation(arm, Series(12.0), candidates=40, seed=5), tmp_path / "held.mcap", 4)
    lacking = armscope.identify(fit, arm, held_out=held, shape="straight")
    said = verdict(lacking)
    assert "Not validated" in said and "times at joint 2 (" in said and "account for" not in said
    mended = armscope.identify(fit, arm, held_out=held)
    assert "Validated on" in verdict(mended)
    assert [(term.name, term.joint) for term in mended.arm.effects] == [("load_friction", 2)]
    assert mended.arm.effects[0].parameters["mu"] == pytest.approx(0.15, abs=0.01)


def test_friction_that_differs_by_direction_bears_nothing_at_rest(arm: Arm, runs: dict[str, Recording]) -> None:
    """With a constant offset in its place, reversals would be wrong by half the difference."""
    even = replace(arm, joints=tuple(replace(j, coulomb=(np.mean(j.coulomb),) * 2) for j in arm.joints))
    by_direction, constant = judged(runs, arm, "same"), judged(runs, even, "same")
    assert by_direction.relative_error(False) < 0.6 * constant.relative_error(False)
    for mine, other in zip(by_direction.base, constant.base):
        if mine.name.endswith("offset"):  # while a joint moves, the two are one
            assert abs(mine.value - other.value) < 3 * max(mine.std, other.std)
