"""On what a residual above the noise depends: a drift of each recording's own, functions where rows are few."""

from __future__ import annotations

import numpy as np

from arm_model import Arm
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.structure.likely_variable import _predicted, likely_variable
from diagnosis.measurements.currents.structure.shared_bases import KNOTS, bends_of, splines_at
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from identification.selection import Split
from tests.diagnosis.one_axis import vertical_joint

RATE, ROTOR, COULOMB, VISCOUS, WIDTH, NOISE, COUNT = 250.0, 2.0, 10.0, 5.0, 0.01, 0.1, 1e-5
AXIS = Arm("axis", (vertical_joint(ROTOR, COULOMB, VISCOUS, WIDTH),))


def _run(seed: int, seconds: float) -> Run:
    """An axis that swings by 0.3 rad, and whose current drifts by 2 A from begin to end."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1 / RATE)
    rate = 2 * np.pi * rng.uniform(0.45, 0.55)
    q = 0.3 * np.sin(rate * t)
    v = np.gradient(q, t, edge_order=2)
    i = ROTOR * np.gradient(v, t, edge_order=2) + VISCOUS * v + COULOMB * v / np.hypot(v, WIDTH)
    i = i + 2.0 * (t / t[-1] - 0.5) + NOISE * rng.normal(size=len(t))
    return residual_run(f"{seed}", AXIS, t, (np.round(q / COUNT) * COUNT)[:, None], i[:, None])


def test_a_drift_of_each_recordings_own_depends_on_time() -> None:
    """Functions of time that are alike in recordings of 18, 13 and 23 s explained 74 % of it."""
    runs = [_run(seed, seconds) for seed, seconds in enumerate((18.0, 13.0, 23.0))]
    data = Split(dataset_of(runs[:2]), dataset_of(runs[2:]))
    found = likely_variable(data, data.map(lambda side: side.y), AXIS, 1)
    assert found is not None and found[0] == "time" and found[2] > 0.95


def test_a_function_goes_on_straight_beyond_the_rows_that_it_is_fitted_to() -> None:
    """Where it went to zero, no function of its position explained a cable that an arm pulls at one end of its way."""
    x = np.linspace(0.0, 1.0, 400)
    fold = np.where(x > 0.8, 0, 1 + np.arange(400) % 3)
    knots = np.linspace(0.0, 1.0, KNOTS)
    straight, to_zero = (_predicted(splines_at(x, knots), x, fold, bends) for bends in (bends_of(knots), None))
    assert np.abs(straight - x).max() < 0.02
    assert to_zero[-1] < 0.5
