"""Designed motions stay inside their limits, show more than random ones, and come out as experiment files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model, write_model
from arm_model.system.dynamics import inverse_dynamics
from armscope.cli import run
from daq.rig.preflight import check_motion
from daq.rig.rig_file import read_rig
from experiment import Experiment, demand_of, read_experiment
from identification.experiment_design import Limits, design_excitation
from identification.experiment_design.criterion import Criterion, score_in_words, scores_of, singular_values
from identification.experiment_design.excitation import ROWS
from identification.experiment_design.fourier_series import sampled
from identification.regression.base_parameters import BaseParameters, structural_base
from tests.arm_model.pumas import three_links


def of_experiments(
    arm: Arm, base: BaseParameters, experiments: Sequence[Experiment], limits: Limits, criterion: Criterion
) -> np.ndarray:
    motions = [sampled(experiment, ROWS) for experiment in experiments]
    t, q, qd, qdd = (np.stack([motion[k] for motion in motions]) for k in range(4))
    return scores_of(arm, base, t[0], (q, qd, qdd), limits, criterion)


@pytest.mark.parametrize("criterion", ["d", "condition"])
def test_design_is_feasible_and_better_than_chance(root: Path, criterion: str) -> None:
    arm = read_model(root / "config/models/scara.toml")
    limits = Limits.of(arm)
    found = design_excitation(arm, criterion=criterion, candidates=96)
    demand = demand_of(found)
    t = np.linspace(0, demand.duration, 20_000)
    q = demand(t)
    qd = np.gradient(q, t, axis=0)
    qdd = np.gradient(qd, t, axis=0)
    slack = 1.02  # limits are held at instants, between which a series moves a little
    low, high = limits.position.T
    assert np.all(np.abs(q - (low + high) / 2) <= slack * (high - low) / 2)
    assert np.all(np.abs(qd).max(axis=0) <= slack * limits.speed)
    assert np.all(np.abs(qdd).max(axis=0) <= slack * limits.acceleration)
    chance = [design_excitation(arm, criterion=criterion, candidates=1, seed=seed) for seed in range(5)]
    scores = of_experiments(arm, structural_base(arm), [found, *chance], limits, criterion)
    assert scores[0] > np.median(scores[1:])


@pytest.mark.parametrize("condition", [1e1, 1e5, 1e9, 1e14])
def test_singular_values_are_those_of_a_decomposition(condition: float) -> None:
    """Well-conditioned ones by the product, others as they are; all to five digits."""
    generator = np.random.default_rng(3)
    u, v = np.linalg.qr(generator.normal(size=(3, 60, 8)))[0], np.linalg.qr(generator.normal(size=(3, 8, 8)))[0]
    true = np.geomspace(2.0, 2.0 / condition, 8)
    found = singular_values(u * true @ v)
    np.testing.assert_allclose(found, np.tile(true, (3, 1)), rtol=1e-4, atol=1e-15)


def test_command_writes_what_record_reads(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, out = root / "config/models/puma560.toml", tmp_path / "excitation.toml"
    assert run(["excite", "--model", str(model), "--out", str(out), "--candidates", "32", "--duration", "10"]) == 0
    printed = capsys.readouterr().out
    found = read_experiment(out)
    arm = read_model(model)
    demand = demand_of(found)
    t = np.linspace(0.0, demand.duration, 2000)
    q = demand(t)
    qd = np.gradient(q, t, axis=0)
    torque = inverse_dynamics(arm, q, qd, np.gradient(qd, t, axis=0))
    assert np.all(np.abs(torque).max(axis=0) < [joint.torque_limit for joint in arm.joints])
    assert np.all(np.ptp(q, axis=0) > 0.05)
    travel = re.findall(r"joint (\d): (\S+) to (\S+) rad, at most (\S+) rad/s", printed)
    expected = np.stack([np.arange(1, len(arm) + 1), q.min(axis=0), q.max(axis=0), np.abs(qd).max(axis=0)], axis=1)
    np.testing.assert_allclose(np.array(travel, float), expected, atol=0.02)


def test_rig_narrower_than_the_model_is_kept_and_accepted(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    text = (root / "config/puma560_sim.toml").read_text()
    text = text.replace('"models/', f'"{root}/config/models/').split("[limits]")[0]
    narrow = {
        "position": [[-0.5, 0.9], [-1.2, 0.2], [0.1, 1.4], [-1, 1], [-1, 1], [-1, 1]],
        "speed": [0.5, 0.4, 0.6, 1.0, 1.0, 1.0],
        "acceleration": [0.8, 0.7, 0.9, 2.0, 2.0, 2.0],
        "current": [4.0, 5.5, 5.0, 3.0, 3.0, 3.0],
    }
    rig, out = tmp_path / "rig.toml", tmp_path / "excitation.toml"
    rig.write_text(text + "[limits]\n" + "\n".join(f"{name} = {values}" for name, values in narrow.items()) + "\n")
    assert run(["excite", "--rig", str(rig), "--out", str(out), "--candidates", "32", "--duration", "10"]) == 0
    found = read_experiment(out)
    assert check_motion(read_rig(rig, drivers=False), found) == []
    assert found.rate == 985.71  # the rig's 1000 rows/s are 28 a setpoint
    arm = read_model(root / "config/models/puma560.toml")
    demand = demand_of(found)
    t = np.linspace(0.0, demand.duration, 4000)
    q = demand(t)
    qd = np.gradient(q, t, axis=0)
    current = inverse_dynamics(arm, q, qd, np.gradient(qd, t, axis=0)) / arm.joint_array("drive_constant")
    assert np.all(np.abs(current).max(axis=0) < narrow["current"])
    assert np.all(np.ptp(q, axis=0) > 0.05)
    # The fiercer motion for the bare model is what this rig refuses, acceleration included.
    assert (
        run(["excite", "--model", str(root / "config/models/puma560.toml"), "--out", str(out), "--candidates", "32"])
        == 0
    )
    refused = " ".join(check_motion(read_rig(rig, drivers=False), read_experiment(out)))
    assert "accelerates" in refused


def test_effects_of_the_model_count(root: Path) -> None:
    arm = three_links(read_model(root / "config/models/puma560.toml"))
    drifting = EffectTerm("friction_drift", 1, {"fraction": 0.2, "time_constant": 6.0})
    arm = replace(arm, effects=(drifting, EffectTerm("load_friction", 2, {"mu": 0.05})))
    base, limits = structural_base(arm), Limits.of(arm)
    assert {"joint1.friction_drift.fraction", "joint2.load_friction.mu"} <= {base.names[k] for k in base.kept}
    still, found = (design_excitation(arm, candidates=count, seed=1) for count in (1, 96))
    scores = of_experiments(arm, base, [still, found], limits, "d")
    assert np.isfinite(scores).all() and scores[1] > scores[0]


def rounded(root: Path, digits: int) -> Arm:
    """A Puma whose angles between axes are written with so many digits."""
    arm = read_model(root / "config/models/puma560.toml")
    return replace(arm, joints=tuple(replace(joint, alpha=round(joint.alpha, digits)) for joint in arm.joints))


def test_right_angles_that_a_file_has_rounded_are_right_angles(root: Path) -> None:
    """What 1.570796 for pi / 2 would show is 3e-7 of a torque, which no motion shows."""
    exact, near = read_model(root / "config/models/puma560.toml"), rounded(root, 6)
    assert len(structural_base(near)) > len(structural_base(exact))
    one, other = (demand_of(design_excitation(arm, candidates=32)) for arm in (exact, near))
    t = np.linspace(0.0, one.duration, 500)
    np.testing.assert_allclose(other(t), one(t), atol=1e-3)


def test_motors_that_hold_the_arm_in_some_poses_only_move_it_there(root: Path) -> None:
    arm = weak(read_model(root / "config/models/puma560.toml"), 0.4)
    demand = demand_of(design_excitation(arm, candidates=64))
    q = demand(np.linspace(0.0, demand.duration, 2000))
    assert np.all(np.ptp(q, axis=0) > 0.02)


def test_motors_too_weak_to_hold_the_arm_are_named(
    root: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_model(tmp_path / "weak.toml", weak(read_model(root / "config/models/puma560.toml"), 0.0005))
    out = tmp_path / "motion.toml"
    assert run(["excite", "--model", str(tmp_path / "weak.toml"), "--out", str(out), "--candidates", "32"]) == 2
    said = capfd.readouterr().err.splitlines()[-1]
    assert said.startswith("error: excite: no motion is within the limits of torque: to move slowly, joint 2 needs ")
    assert not out.exists()


def weak(arm: Arm, share: float) -> Arm:
    """An arm whose second motor has a share of the torque that holds it stretched out."""
    still = np.zeros((1, len(arm)))
    weight = float(np.abs(inverse_dynamics(arm, still, still, still)).max())
    first, second, *rest = arm.joints
    return replace(arm, joints=(first, replace(second, torque_limit=share * weight), *rest))


@pytest.mark.parametrize(("condition", "printed"), [(123.4, "123"), (1e13, "above 1e+12"), (np.inf, "above 1e+12")])
def test_a_condition_number_beyond_any_number_is_printed_as_such(condition: float, printed: str) -> None:
    """Parameters that a motion does not show at all made it exp(800), with a warning of numpy."""
    assert score_in_words(-np.log(condition), "condition") == printed
