"""Functions that a residual may depend on, against the same written row by row."""

from __future__ import annotations

import numpy as np
import pytest

from arm_io.types import Array
from diagnosis.measurements.currents.structure.basis_functions import _plane_wave, _play
from diagnosis.measurements.currents.structure.shared_bases import harmonics_of
from diagnosis.residual.noise.channels import QUIET_ROWS, quiet_noise


def _row_by_row(values: Array, width: float) -> Array:
    kept, at = np.empty_like(values), float(values[0])
    for row, value in enumerate(values.tolist()):
        at = min(max(at, value - width), value + width)
        kept[row] = at
    return kept


@pytest.mark.parametrize("rows", [1, 2, 3, 64, 1000])
def test_play_is_a_clamp_per_row(rows: int) -> None:
    values = np.cumsum(np.random.default_rng(rows).standard_normal(rows))
    widths = np.array([0.1, 1.0, 5.0, 50.0])
    assert np.array_equal(_play(values, widths), np.stack([_row_by_row(values, w) for w in widths], axis=1))


def test_the_strongest_wave_of_two_angles_is_found() -> None:
    random = np.random.default_rng(1)
    own, other = np.cumsum(random.standard_normal((2, 3000)), axis=1) / 20
    for c, d in ((2.5, 1.0), (-3.0, 4.5), (0.5, 8.0)):
        wave = np.sin(c * own + d * other + 0.7) + 0.3 * random.standard_normal(3000)
        assert _plane_wave(wave, harmonics_of(own), harmonics_of(other)) == (c, d)


def test_quiet_noise_is_the_scatter_about_straight_lines() -> None:
    random = np.random.default_rng(2)
    residual = random.standard_normal((2000, 3)) + np.linspace(0.0, 30.0, 2000)[:, None]
    known, block = random.random((2000, 3)) > 0.3, np.arange(2000) // 100
    for j, found in enumerate(quiet_noise(residual, known, block)):
        stds = []
        for number in range(20):
            rows = np.flatnonzero((block == number) & known[:, j])
            if len(rows) >= QUIET_ROWS:
                line = np.polynomial.Polynomial.fit(rows, residual[rows, j], 1)
                stds.append(np.std(residual[rows, j] - line(rows)))
        assert abs(found - np.quantile(stds, 0.2)) < 1e-10
