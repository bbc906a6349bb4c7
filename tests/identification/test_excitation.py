"""Designed motions stay inside their limits, show more than random ones, and come out as experiment files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model.dynamics import inverse_dynamics
from arm_model.model_file import read_model
from armscope.cli import run
from experiment import demand_of, read_experiment
from identification.equations import structural_base
from identification.excitation import Limits, design_excitation, excitation_scores


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
    scores = excitation_scores(arm, structural_base(arm), [found, *chance], limits, criterion)
    assert scores[0] > np.median(scores[1:])


def test_command_writes_what_record_reads(root: Path, tmp_path: Path) -> None:
    model, out = root / "config/models/puma560.toml", tmp_path / "excitation.toml"
    assert run(["excite", "--model", str(model), "--out", str(out), "--candidates", "32", "--duration", "10"]) == 0
    found = read_experiment(out)
    arm = read_model(model)
    demand = demand_of(found)
    t = np.linspace(0.0, demand.duration, 2000)
    q = demand(t)
    qd = np.gradient(q, t, axis=0)
    torque = inverse_dynamics(arm, q, qd, np.gradient(qd, t, axis=0))
    assert np.all(np.abs(torque).max(axis=0) < [joint.torque_limit for joint in arm.joints])
    assert np.all(np.ptp(q, axis=0) > 0.05)
