"""Steps of the simulation that friction at rest asks for: what is simulated by default is what many more steps give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io.types import Array
from arm_model import read_model
from arm_model.simulation import simulate
from arm_model.simulation.lanes import needed_substeps
from arm_model.simulation.servo_references import servo_period
from arm_model.system.friction_rate import MOST, friction_rates, softened
from arm_model.system.kernel_inputs import numbers


def _creeping(joints: int) -> Callable[[Array], Array]:
    """A demand (m,) s -> (m, joints): at rest, then a slow sine with its reversals, then at rest."""

    def demand(t: Array) -> Array:
        moving = np.clip(t - 0.3, 0.0, 2.0)
        return np.repeat(0.05 * np.sin(np.pi * moving)[:, None] ** 2, joints, axis=1)

    return demand


@pytest.mark.parametrize("name", ["emps", "puma560", "scara_driven", "cylindrical"])
def test_shipped_models_are_simulated_as_with_many_more_steps(root: Path, name: str) -> None:
    arm = read_model(root / f"config/models/{name}.toml")
    coarse, fine = (
        simulate(arm, _creeping(len(arm)), duration=2.8, rate=500.0, substeps=steps).current for steps in (None, 64)
    )
    assert np.sqrt(np.mean((coarse - fine) ** 2, axis=0)).max() < 1e-3 * np.std(fine, axis=0).max()


def test_the_rate_is_that_of_friction_over_smoothing_velocity_and_inertia(root: Path) -> None:
    arm = read_model(root / "config/models/emps.toml")
    axis = arm.joints[0]
    inertia = axis.mass + axis.ratio**2 * axis.rotor_inertia
    slope = axis.coulomb[0] / axis.sign_velocity + axis.viscous[0]
    assert friction_rates(arm, numbers(arm))[0, 0] == pytest.approx(slope / inertia, rel=1e-3)


def test_friction_that_no_step_can_follow_is_smoothed_over_a_larger_velocity(root: Path) -> None:
    arm = read_model(root / "config/models/emps.toml")
    stiff = replace(arm, joints=(replace(arm.joints[0], sign_velocity=5e-7),))
    inputs, period = numbers(stiff), servo_period(stiff)
    soft = softened(stiff, inputs, period)
    assert 3 * 5e-7 < soft["sign_velocity0"][0] < 4 * 5e-7
    (steps,) = needed_substeps(stiff, soft, period)
    assert MOST <= steps <= MOST + 1  # viscous friction is not smoothed
    assert softened(arm, numbers(arm), period)["sign_velocity0"] == numbers(arm)["sign_velocity0"]
