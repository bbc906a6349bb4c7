"""Friction that the data do not determine stays as in the model, unless the total friction would drive the joint."""

from __future__ import annotations

import numpy as np
import pytest

from arm_model import Arm, Joint
from identification.regression.friction_rows import friction_rows
from identification.regression.physical_consistency import BaseFit, Prior, consistent_parameters

NAMES = ("joint1.coulomb", "joint1.viscous")
AT_REST_AND_AT_1_RAD_PER_S = np.array([[1.0, 0.0], [1.0, 1.0]])
COULOMB_ALONE = np.array([[1.0, 0.0]])


def test_friction_has_a_row_for_each_direction_and_speed() -> None:
    """Of two directions with friction of their own, a row has that of its direction alone."""
    arm = Arm(name="axis", joints=(Joint(coulomb=(1.0, 2.0), viscous=(0.5, 0.5)),))
    names = ("joint1.coulomb_positive", "joint1.coulomb_negative", "joint1.viscous", "joint1.rotor_inertia")
    rows = friction_rows(arm, names, [2.0])
    forwards, backwards = rows[rows[:, 0] > 0.0], rows[rows[:, 1] > 0.0]
    assert len(forwards) == len(backwards) == len(rows) / 2 > 10
    np.testing.assert_array_equal(forwards[:, [1, 0, 2, 3]], backwards)
    assert rows[:, 2].min() >= 0.0 and rows[:, 2].max() >= 2.0 and not rows[:, 3].any()


def _estimated(coulomb: float, prior: tuple[float, float]) -> np.ndarray:
    return consistent_parameters(
        BaseFit(COULOMB_ALONE, np.array([coulomb]), np.array([[1e8]])),
        Prior(NAMES, np.array(prior), friction=AT_REST_AND_AT_1_RAD_PER_S),
    )


def test_what_the_data_do_not_determine_is_the_priors() -> None:
    assert _estimated(2.0, (3.0, -1.0)) == pytest.approx([2.0, -1.0], abs=1e-3)


def test_less_coulomb_friction_does_not_leave_a_viscous_friction_that_drives() -> None:
    found = _estimated(1.0, (3.0, -2.0))
    assert found[0] == pytest.approx(1.0, abs=1e-3)
    assert (AT_REST_AND_AT_1_RAD_PER_S @ found).min() >= 0.0


@pytest.mark.parametrize("size", [1.0, 1e3])
def test_a_model_without_friction_draws_none_of_it_away(size: float) -> None:
    """As from URDF. Of 150 N m that are known to 1 N m, two were missing; of a gantry's 150 kN, two thousand."""
    speeds = np.linspace(0.0, 1.0, 25)
    rows = np.tile(np.column_stack([np.ones(25), speeds]), (2, 1))
    true = size * np.array([150.0, 40.0])
    found = consistent_parameters(BaseFit(np.eye(2), true, np.eye(2) / size**2), Prior(NAMES, np.zeros(2), rows))
    assert np.abs(found - true).max() < 0.01 * size
