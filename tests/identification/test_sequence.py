"""Joint by joint: the stated covariance of each step has in it what the steps before got wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armscope
from arm_model import write_model
from armscope import cli
from identification.methods.sequential import Known, next_step
from identification.regression.equations import Equations
from tests.diagnosis.numpy_arm import RATE, model

TRUTH = np.array([2.0, -1.0, 0.5, 3.0])
ROWS, RUNS = 60, 60


def step_of(columns: np.ndarray, noise: float, rng: np.random.Generator) -> Equations:
    torque = columns @ TRUTH + noise * rng.standard_normal(len(columns))
    nobody = np.zeros(len(columns), np.intp)
    return Equations(columns, torque, nobody, nobody, np.arange(len(columns)) * 1e-2, ("a", "b", "c", "d"))


def test_two_deviations_hold_the_truth_after_the_last_step() -> None:
    """A tip that shows its two parameters badly, and a base whose torque has much of these in it, measured well."""
    rng = np.random.default_rng(20)
    tip = rng.standard_normal((ROWS, 4)) * [0, 0, 1, 1]
    base = rng.standard_normal((ROWS, 4)) @ np.array([[1, 0, 2, 0], [0, 1, 0, 3], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    off, distance = np.empty((RUNS, 4)), np.empty(RUNS)
    for run in range(RUNS):
        known = Known(TRUTH + 0.3 * rng.standard_normal(4), np.eye(4), np.eye(4))
        for columns, noise in ((tip, 0.5), (base, 0.05)):
            known, _ = next_step(known, columns, step_of(columns, noise, rng))
        error = known.values - TRUTH
        off[run] = error / np.sqrt(np.diag(known.covariance))
        distance[run] = error @ np.linalg.solve(known.covariance, error)
    assert known.open.shape == (4, 0)
    assert np.all(np.mean(np.abs(off) < 2, axis=0) > 0.9)
    # of the first two alone, without what they inherit, it would be some hundred; far below 1 they would be unsure
    assert np.all((np.mean(off**2, axis=0) > 0.5) & (np.mean(off**2, axis=0) < 1.3))
    assert 2.0 < np.mean(distance) < 6.0  # 4, were every covariance exact: correlations between the steps are right


def test_what_no_step_shows_stays_the_model_s_with_the_model_s_uncertainty() -> None:
    rng = np.random.default_rng(21)
    columns = rng.standard_normal((ROWS, 4)) * [0, 1, 0, 1]
    known, _ = next_step(Known(np.ones(4), np.eye(4), np.eye(4)), columns, step_of(columns, 0.1, rng))
    np.testing.assert_allclose(known.values[[0, 2]], 1.0)
    np.testing.assert_allclose(known.covariance[np.ix_([0, 2], [0, 2])], np.eye(2), atol=1e-9)
    assert np.all(np.sqrt(np.diag(known.covariance))[[1, 3]] < 0.05)
    again, condition = next_step(known, 0 * columns, step_of(0 * columns, 0.1, rng))
    assert again is known and np.isnan(condition)


def test_friction_of_a_joint_that_never_moves_is_the_model_s(tmp_path: Path) -> None:
    """Its columns are exactly zero in every row."""
    t = np.arange(0.0, 12.0, 1 / RATE)
    q1 = 0.8 * np.sin(2.1 * t) + 0.3 * np.sin(5.3 * t)
    i1 = 2.0 * np.sign(np.gradient(q1)) + np.gradient(np.gradient(q1, t), t) + 3.0 * np.cos(q1)
    noise = 0.01 * np.random.default_rng(22).normal(size=(2, len(t)))
    table = np.column_stack([t, q1, np.full(len(t), 0.5), i1 + noise[0], np.cos(q1 + 0.5) + noise[1]])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,q1,q2,i1,i2", comments="", fmt="%.9g")
    assert cli.run(["import", str(tmp_path / "a.csv"), "--out", str(tmp_path / "a.mcap")]) == 0
    write_model(tmp_path / "model.toml", model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0]))
    result = armscope.identify(tmp_path / "a.mcap", tmp_path / "model.toml", method="sequence")
    found = {value.name: value for value in result.parameters}
    assert np.isclose(found["joint2.viscous"].value, 4.0) and found["joint1.coulomb"].std is not None
