"""Nonlinear parameters between and beyond the values of a search grid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import read_model
from arm_model.effects import CATALOGUE
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.measurements.currents.design_matrix import Library, columns_at_joint, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.refinement import refined
from diagnosis.residual.expected_current import delayed
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import best_of_each, fit_together
from identification.selection import Split


@pytest.fixture(scope="module")
def run(root: Path) -> Run:
    """The Puma, shaken at up to 8 Hz."""
    t = np.arange(0.0, 8.0, 0.005)
    sweep = np.sin(2 * np.pi * (0.5 + 0.45 * t) * t)
    q = np.outer(sweep, [0.02, 0.03, 0.04, 0.05, 0.06, 0.07])
    return residual_run("a", read_model(root / "config/models/puma560.toml"), t, q, np.zeros_like(q))


@pytest.mark.parametrize(("stiffness", "damping"), [(4000.0, 2.5), (3000.0, 6.0), (3000.0, 15.0), (6000.0, 60.0)])
def test_the_damping_of_a_spring_is_found_far_from_its_grid(run: Run, stiffness: float, damping: float) -> None:
    def spring(k: float, d: float) -> Candidate:
        return Candidate("joint_compliance", 2, (("stiffness", k), ("damping", d)))

    data = dataset_of([replace(run, current=run.expected + columns(spring(stiffness, damping), run)[..., 0])])
    nearest = spring(1.1 * stiffness, 20.0 if damping < 40.0 else 80.0)
    found = dict(refined(nearest, fit_together(Split(data, data), []), data).shape)
    assert found["stiffness"] == pytest.approx(stiffness, rel=0.03)
    assert found["damping"] == pytest.approx(damping, rel=0.1)


@pytest.mark.parametrize(("joint", "stiffness", "damping"), [(2, 1200.0, 1.0), (2, 6000.0, 5.0), (3, 3000.0, 2.0)])
def test_the_grid_leads_to_a_spring_that_rings(run: Run, joint: int, stiffness: float, damping: float) -> None:
    """Of a spring that rings in the motion's band, another spring with ten times its damping shows next to nothing."""
    hidden = Candidate("joint_compliance", joint, (("stiffness", stiffness), ("damping", damping)))
    data = dataset_of([replace(run, current=run.expected + columns(hidden, run)[..., 0])])
    alone, grid = fit_together(Split(data, data), []), [c for c in candidates(run.arm) if c.key == hidden.key]
    (best,) = best_of_each(grid, lambda c: columns_at_joint(c, data), alone, set())
    found = dict(refined(best, alone, data).shape)
    assert found["stiffness"] == pytest.approx(stiffness, rel=0.02)
    assert found["damping"] == pytest.approx(damping, rel=0.05)


@pytest.mark.parametrize(("hidden", "found"), [(0.006, 0.006), (0.0073, 0.0073), (0.009, 0.0075)])
def test_a_gap_is_refined_within_what_a_gear_may_have(run: Run, hidden: float, found: float) -> None:
    """One of 7.3 mrad in noise was 7.6, wider than any gear has: what was named instead explained a third of it."""

    def gap(half: float) -> Candidate:
        return Candidate("backlash", 4, (("half_gap", half),))

    data = dataset_of([replace(run, current=run.expected + columns(gap(hidden), run)[..., 0])])
    best = dict(refined(gap(0.0075), fit_together(Split(data, data), []), data).shape)["half_gap"]
    assert best == pytest.approx(found, rel=0.03) and best <= CATALOGUE["backlash"]["half_gap"].most


@pytest.mark.parametrize("delay", [5e-4, -0.006, 0.014, -0.02])
def test_a_delay_is_found_however_long(run: Run, delay: float) -> None:
    """Of currents that change at up to 8 Hz a first-order change does not serve for the longer three."""
    late = delayed(run.t, run.expected, np.full(len(run.t), delay))
    shown = replace(run, current=late, current_rate=np.gradient(late, run.t, axis=0))
    data = Split(dataset_of([shown]), dataset_of([shown]))
    model = Currents(run.arm, data, Library([Candidate("time_skew", None)], data), [])
    (score,) = model.scores(model.start())
    assert score.gain > 0.98 * float(np.sum(data.fit.y**2))
    assert score.coefficients[0] == pytest.approx(delay, rel=0.03)


def test_a_delay_whose_value_does_not_settle_is_no_candidate(run: Run) -> None:
    """What has nothing to do with the currents looks like delays of any length, each about the one before."""
    rng, skew = np.random.default_rng(1), Candidate("time_skew", None)
    other = 300.0 * np.cumsum(rng.standard_normal(run.expected.shape), axis=0) / np.sqrt(len(run.t))
    current = run.expected + other
    shown = replace(run, current=current, current_rate=np.gradient(run.expected, run.t, axis=0))
    data = Split(dataset_of([shown]), dataset_of([shown]))
    model = Currents(run.arm, data, Library([skew], data), [])
    (score,) = model.scores(model.start())
    assert score.candidate == skew and len(model.library) > 2
