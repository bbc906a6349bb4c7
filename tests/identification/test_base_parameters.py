"""Base parameters: their number from the literature, their identity on random states, their groups."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from identification.regression.base_parameters import base_parameters, structural_base
from identification.regression.model_parameters import column_names, model_columns, model_values


def test_puma_has_the_thirty_six_inertial_base_parameters_of_the_literature(root: Path) -> None:
    # Mayeda, Yoshida, Osuka, IEEE T-RA 6(3), 1990: 36 for the PUMA 560, rotors aside; here each of joints 3-6 has a
    # rotor of its own.
    arm = read_model(root / "config/models/puma560.toml")
    base = structural_base(arm)
    rigid = [k for k in base.kept if base.names[k].startswith("link")]
    rotors = [k for k in base.kept if base.names[k].endswith("rotor_inertia")]
    assert len(rotors) == 6
    assert len(rigid) + 2 == 36  # those of joints 1 and 2 are summed with link inertias
    assert len(base) == 34 + 6 + 3 * 6


@pytest.mark.parametrize("model", ["puma560", "panda", "emps", "gantry", "cylindrical"])
@pytest.mark.parametrize("friction", ["symmetric", "asymmetric"])
def test_grouped_columns_give_the_same_torque(root: Path, model: str, friction: str) -> None:
    arm = read_model(root / f"config/models/{model}.toml")
    base = structural_base(arm, friction)
    random = np.random.default_rng(7)
    q, qd, qdd = random.standard_normal((3, 30, len(arm)))
    columns = model_columns(arm, q, qd, qdd, friction).reshape(-1, len(base.names))
    delta = model_values(arm, friction) + random.standard_normal(len(base.names))
    whole = columns @ delta
    assert np.allclose(columns[:, base.kept] @ (base.grouping @ delta), whole, atol=1e-8 * np.max(np.abs(whole)))


def test_expression_names_the_sum() -> None:
    random = np.random.default_rng(0)
    a, b = random.standard_normal((2, 50))
    columns = np.stack([a, b, 2 * a - b, 0 * a], axis=1)
    base = base_parameters(columns, ["link1.mx", "link1.my", "link1.mass", "link1.izz"])
    assert [base.expression(k) for k in range(len(base))] == ["link1.mx + 2 link1.mass", "link1.my - link1.mass"]
    assert not base.alone(0)


def test_one_prismatic_axis_shows_its_mass_and_friction(root: Path) -> None:
    arm = read_model(root / "config/models/emps.toml")
    base = structural_base(arm)
    assert sorted(base.expression(k) for k in range(len(base))) == [
        "joint1.coulomb",
        "joint1.offset",
        "joint1.viscous",
        "link1.mass",
    ]
    assert "joint1.rotor_inertia" not in column_names(arm, "symmetric")


def test_columns_without_an_entry_are_no_parameters() -> None:
    assert len(base_parameters(np.zeros((10, 3)), ["link1.mx", "link1.my", "link1.mz"])) == 0
    few = base_parameters(np.ones((2, 3)), ["link1.mx", "link1.my", "link1.mz"])
    assert few.expression(0) == "link1.mx + link1.my + link1.mz"


def test_kept_columns_are_the_first_independent_ones_in_order() -> None:
    random = np.random.default_rng(5)
    for _ in range(20):
        # Every third column a sum of earlier ones: scattered, so that the search begins anew many times.
        columns = random.standard_normal((60, 30))
        for k in range(2, 30, 3):
            columns[:, k] = columns[:, :k] @ random.standard_normal(k)
        base = base_parameters(columns, [f"link1.c{k}" for k in range(30)], order=range(30))
        assert base.kept.tolist() == [k for k in range(30) if k % 3 != 2]
        assert np.allclose(columns[:, base.kept] @ base.grouping, columns, atol=1e-9)
