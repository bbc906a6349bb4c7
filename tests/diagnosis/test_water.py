"""What water does to a recording is in the span of the columns by which diagnosis looks for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.hydrodynamics import own_drag
from arm_model.simulation.simulation import simulate
from arm_model.tables.link_shapes import Cylinder
from diagnosis.measurements.currents.causes import of_candidate
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.residual.generation import residual_run
from diagnosis.selection.candidate import Candidate
from identification.selection import Split, select
from tests.arm_model.pumas import three_links


def immersed(arm: Arm, **coefficients: float) -> Arm:
    body = Cylinder((0.0, 0.0, 0.0), (-0.4318, 0.0, 0.0), 0.1, **coefficients)
    first, second, third = arm.joints
    return replace(arm, joints=(first, replace(second, cylinder=body), third))


def sweep(t: np.ndarray) -> np.ndarray:
    return np.outer(1 - np.cos(2.2 * t), [0.6, 0.0, 0.0]) + np.outer(np.sin(3.1 * t) - 3.1 * t / (1 + t), [0, 0.4, 0.3])


def test_water_round_one_link_is_found_in_the_currents(root: Path) -> None:
    """Drag, added mass and buoyancy of the upper arm of a simulated wet arm, by least squares."""
    arm = three_links(read_model(root / "config/models/puma560.toml"))
    model = immersed(arm)
    wet = immersed(arm, drag_coefficient=1.2, added_mass_coefficient=1.5, buoyancy=0.8)
    motion = simulate(wet, sweep, duration=8.0, rate=1000)
    run = residual_run("wet", model, motion.t, motion.qm, motion.current)
    changes = [columns(Candidate(name, 2), run) for name in ("hydrodynamic_drag", "added_mass")]
    # rows apart from standstill, where friction depends on more than the speed
    moving = (np.abs(run.v) > 0.1).all(axis=1)
    x = np.concatenate(changes, axis=-1)[moving].reshape(-1, 3)
    found = np.linalg.lstsq(x, run.residual[moving].ravel(), rcond=None)[0]
    np.testing.assert_allclose(found, [1.2 * own_drag(model, 2), 1.5, 0.8], rtol=0.05)


def test_added_mass_is_looked_for_where_there_is_a_body(root: Path) -> None:
    arm = three_links(read_model(root / "config/models/puma560.toml"))
    assert {c.joint for c in candidates(immersed(arm)) if c.effect == "added_mass"} == {2}
    assert {c.joint for c in candidates(immersed(arm)) if c.effect == "hydrodynamic_drag"} == {1, 2, 3}
    assert not [c for c in candidates(arm) if c.effect == "added_mass"]


@pytest.mark.parametrize(("added", "less"), [(0.9, 0.001), (0.9, 0.0), (0.0, -0.3)])
def test_water_that_moves_with_a_link_need_not_carry_it(root: Path, added: float, less: float) -> None:
    """A buoyancy that nothing was hidden of is negative in every second fit, and refused the mass that was there."""
    arm = three_links(read_model(root / "config/models/puma560.toml"))
    model = immersed(arm, buoyancy=0.4)
    wet = immersed(arm, added_mass_coefficient=added, buoyancy=0.4 - less)
    runs = []
    for number, duration in enumerate((7.0, 6.0)):
        motion = simulate(wet, sweep, duration=duration, rate=250)
        noise = 0.01 * np.random.default_rng(number).normal(size=motion.current.shape)
        runs.append(residual_run("wet", model, motion.t, motion.qm, motion.current + noise))
    data = Split(dataset_of(runs[:1]), dataset_of(runs[1:]))
    every = [c for c in candidates(model) if c.effect in ("added_mass", "hydrodynamic_drag")]
    state = select(Currents(model, data, Library(every, data), []))
    assert [c.key for c in state.chosen] == [("added_mass", 2)]
    (values,) = estimates_of(state)
    (value,) = values  # nothing is said of the other
    assert value.name == ("coefficient" if added else "buoyancy")
    assert value.value == pytest.approx(added or -less, abs=max(2 * value.std, 0.03))
    assert of_candidate(state.chosen[0], values, state).group == (("added_mass", 2),)
