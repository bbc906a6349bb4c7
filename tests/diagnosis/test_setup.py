"""Runs that a person prepared: a known payload is no cause, and with the drives off only instruments show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model
from arm_model.simulation.simulation import simulate
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run_setup import loaded
from diagnosis.selection.candidate import Candidate
from experiment.file import Payload


@pytest.fixture(scope="module")
def puma(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


def test_with_the_drives_off_only_what_instruments_add_is_looked_for(puma: Arm) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(4000) / 1000
    still = np.tile([0.3, -0.7, 0.4, 0.0, 0.5, 0.0], (len(t), 1))
    off = rng.normal(scale=0.005, size=still.shape) + 0.05
    run = residual_run("off", puma, t, still, off, powered=False)
    # neither gravity nor friction is expected: what is there counts in units of the transducers' scatter, which is all
    # of the uncertainty
    assert np.all(np.abs(run.residual - 0.05) < 0.01)
    assert np.all(run.deviation < 0.005)
    on = residual_run("on", puma, t, still, off)
    for candidate in {c.effect: c for c in candidates(puma)}.values():
        change = columns(candidate, run)
        assert candidate.definition.current is not None or not np.any(change), candidate
        assert change.shape == columns(candidate, on).shape
    assert np.allclose(columns(Candidate("current_offset", 2), run)[:, 1], 1.0)


def test_a_known_payload_is_in_the_arm_that_a_run_is_seen_through(puma: Arm) -> None:
    payload = Payload(mass=2.0, com=(0.0, 0.02, 0.05))
    term = EffectTerm("payload", None, {"mass": 2.0, "x": 0.0, "y": 0.02, "z": 0.05})

    def sway(t: np.ndarray) -> np.ndarray:
        return np.outer(np.sin(t), [0.3, 0.2, 0.3, 0.1, 0.2, 0.1]) + [0.0, -0.7, 0.4, 0.0, 0.5, 0.0]

    motion = simulate(replace(puma, effects=(term,)), sway, duration=5.0, rate=1000.0)
    with_it = residual_run("run", loaded(puma, payload), motion.t, motion.qm, motion.current)
    without = residual_run("run", puma, motion.t, motion.qm, motion.current)
    moving = np.abs(with_it.v[:, 1]) > 0.05
    assert np.std(with_it.residual[moving, 1]) < 0.05 * np.std(without.residual[moving, 1])
    error = Candidate("torque_constant", 2)
    assert np.ptp(columns(error, with_it)[:, 1]) > 1.02 * np.ptp(columns(error, without)[:, 1])
