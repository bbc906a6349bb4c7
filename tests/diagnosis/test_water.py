"""What water does to a recording is in the span of the columns by which diagnosis looks for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_model.description import Arm, Cylinder
from arm_model.model_file import read_model
from arm_model.rigid_body.hydrodynamics import own_drag
from arm_model.simulation.simulation import simulate
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.residual.generation import residual_run
from diagnosis.selection.candidate import Candidate
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
