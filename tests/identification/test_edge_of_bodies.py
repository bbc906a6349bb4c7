"""Data that no body explains lead to the edge of what is a body, and no further, however sure they are."""

from __future__ import annotations

import numpy as np
import pytest

from arm_model.rigid_body.inertia import PARAMETERS, pseudo_inertia
from identification.regression.physical_consistency import BaseFit, Prior, consistent_parameters

NAMES = [f"link1.{name}" for name in PARAMETERS]
PRIOR = np.array([1.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.01, 0.0, 0.01])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("std", [1e-4, 1e-7, 1e-10])
def test_contradictory_data_lead_to_a_body(std: float) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        grouping = rng.normal(size=(3 + seed % 8, 10))
        base = rng.normal(size=len(grouping))
        found = consistent_parameters(BaseFit(grouping, base, np.eye(len(base)) / std**2), Prior(NAMES, PRIOR))
        assert np.linalg.eigvalsh(pseudo_inertia(found))[0] > 0.0


def test_a_thin_body_is_found() -> None:
    """A body of six points, far from the prior and thin: it is found through its sums."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.normal(size=(6, 3)) * [0.3, 0.1, 1e-4], np.ones(6)])
    p = points.T @ points / 6
    inertia = np.trace(p[:3, :3]) * np.eye(3) - p[:3, :3]
    true = np.concatenate([[p[3, 3]], p[:3, 3], inertia[np.triu_indices(3)]])
    grouping = rng.normal(size=(10, 10))
    found = consistent_parameters(BaseFit(grouping, grouping @ true, np.eye(10) / 1e-10**2), Prior(NAMES, PRIOR))
    assert found == pytest.approx(true, abs=1e-6)
