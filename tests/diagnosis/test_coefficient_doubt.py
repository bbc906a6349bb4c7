"""Held-out rows that ask for what the fitted ones hardly say are no finding; what no coefficient does is one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis.measurements.currents.structure import coefficient_doubt
from diagnosis.measurements.currents.structure.coefficient_doubt import CoefficientDoubt
from diagnosis.selection.design import Columns

ROWS, ALIKE = 2000, 2.5


@pytest.mark.parametrize(("std", "remains"), [(2.0, 0.0), (1e-3, 1.0)])
def test_a_residual_is_judged_beside_the_doubt_about_the_coefficients(
    monkeypatch: pytest.MonkeyPatch, std: float, remains: float
) -> None:
    """Ten coefficients of a link left 2.7 times the noise at a joint whose inertia the fitted rows had not shown.

    std: of the second of two coefficients, which is wrong by 1.5; the first is wrong by half, and known to 1e-3.
    """
    rng = np.random.default_rng(3)
    x, noise = rng.normal(size=(ROWS, 2)), rng.normal(size=ROWS)
    covariance = np.diag([1e-6, std**2])
    monkeypatch.setattr(coefficient_doubt, "covariance_of", lambda state: (covariance, [slice(0, 2)]))
    side = SimpleNamespace(y=noise, runs=[SimpleNamespace(alike=ALIKE)])
    model = SimpleNamespace(columns=lambda cause: SimpleNamespace(held_out=Columns(x, slice(0, ROWS))))
    state = SimpleNamespace(chosen=("cause",), model=model, data=SimpleNamespace(held_out=side))
    beside = CoefficientDoubt(cast(Any, state)).beside(noise + x @ np.array([0.5, 1.5]))
    left = np.linalg.lstsq(x, beside - noise, rcond=None)[0]
    assert left == pytest.approx([0.5, 1.5 * remains], abs=0.1)
    assert np.std(beside - x @ left) == pytest.approx(1.0, abs=0.05)
