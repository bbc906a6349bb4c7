"""Recorded demands: the host's plan, or the servos' lines between setpoints.

The closed loop is simulated on what the servos tracked.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.simulation.servo_references import Sampled
from arm_model.simulation.simulation import simulate_at
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from experiment import demand_of
from identification.experiment_design import Series, design_excitation
from identification.identify import identify_by
from identification.preprocessing.demands import demand_of_run, setpoints_behind
from identification.regression.base_parameters import structural_base
from identification.regression.model_parameters import model_values
from tests.arm_model.pumas import three_links

RATE = 14.4 / 0.028  # Hz, no multiple of the setpoints' rate


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return three_links(read_model(root / "config/models/puma560.toml"))


@pytest.fixture(scope="module")
def runs(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """One run of the servos; beside it the plan, and what they made of it."""
    demand = demand_of(design_excitation(arm, Series(12.0), candidates=160, seed=3))
    t = np.arange(int(demand.duration * RATE) - 1) / RATE
    run = simulate_at(arm, demand, t)
    random = np.random.default_rng(0)
    q = np.floor(run.qm / 1e-4 + random.uniform(0, 1, 3)) * 1e-4
    i = run.current + 0.01 * random.standard_normal(q.shape)
    knots = np.arange(0, demand.duration + 0.028, 0.028)
    lines = np.column_stack([np.interp(t, knots, column) for column in demand(knots).T])
    found = {}
    for name, asked in (("plan", demand(t)), ("lines", lines)):
        path = tmp_path_factory.mktemp("runs") / f"{name}.mcap"
        write_table(path, t, {"q": q, "i": i, "qref": asked}, Attachments())
        found[name] = open_recording(path)
    return found


def test_plan_and_lines_are_told_apart(arm: Arm, runs: dict[str, Recording]) -> None:
    later = replace(runs["lines"], t=runs["lines"].t[5:], q=runs["lines"].q[5:], i=runs["lines"].i[5:])
    later = replace(later, qref=runs["lines"].qref[5:])  # its first row is at no setpoint
    assert isinstance(demand_of_run(later, arm), Sampled)
    plan, knots = runs["plan"], np.arange(0, 12.0, 0.028)
    of_plan, of_lines = demand_of_run(plan, arm), demand_of_run(runs["lines"], arm)
    assert not isinstance(of_plan, Sampled)
    # to what straight lines between rows cut off the plan
    assert np.abs(of_plan(knots) - of_lines(knots)).max() < 2e-5


@pytest.mark.parametrize("rows", [1.0, 1.2, 1.25, 2.5, 4.85, 10.0])
def test_rows_of_straight_lines_show_the_setpoints_between_them(rows: float) -> None:
    random, period = np.random.default_rng(2), 0.01
    setpoints = random.normal(size=(200, 2))
    t = np.arange(int(198.5 * rows)) * period / rows
    lines = np.column_stack([np.interp(t, period * np.arange(200), column) for column in setpoints.T])
    found = setpoints_behind(lines, t, period)
    assert found is not None
    assert np.abs(found[:190] - setpoints[:190]).max() < 1e-9


def test_a_smooth_plan_and_too_few_rows_show_no_setpoints() -> None:
    t = np.arange(1000) / 125.0
    assert setpoints_behind(np.sin(5.0 * t)[:, None], t, 0.01) is None
    slow = np.arange(1000) / 80.0
    assert setpoints_behind(np.zeros((1000, 1)), slow, 0.01) is None


@pytest.mark.parametrize("kind", ["plan", "lines"])
def test_closed_loop_knows_as_much_as_inverse_dynamics_from_either(
    kind: str, arm: Arm, runs: dict[str, Recording]
) -> None:
    result, inverse = (identify_by(method, [runs[kind]], arm, friction="asymmetric") for method in ("didim", "wls"))
    base = structural_base(arm, "asymmetric")
    truth = {base.expression(k): v for k, v in enumerate(base.grouping @ model_values(arm, "asymmetric"))}
    off = np.array([(value.value - truth[value.name]) / value.std for value in result.base])
    assert np.mean(np.abs(off) < 2) > 0.85 and np.max(np.abs(off)) < 4
    # A plan taken for the lines leaves residuals that make the deviations several times as large.
    assert np.median([mine.std / other.std for mine, other in zip(result.base, inverse.base)]) < 1.5
