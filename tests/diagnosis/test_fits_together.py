"""Columns of candidates fitted together, against the least squares and the sums of numpy."""

from __future__ import annotations

import numpy as np

from diagnosis.selection.design import Columns, Dataset
from diagnosis.selection.regression import fit_together
from identification.selection import Split

ROWS, JOINTS = 400, 2


def _side(rng: np.random.Generator, block: np.ndarray) -> Dataset:
    return Dataset((), (), rng.normal(size=JOINTS * ROWS), np.tile(block, JOINTS), ROWS)


def _pair(x: np.ndarray, first: int) -> Split[Columns]:
    where = slice(first, first + len(x))
    return Split(Columns(x, where), Columns(2.0 * x, where))


def test_coefficients_and_residuals_are_those_of_least_squares() -> None:
    """Of columns of one joint and of both, whose units differ by 1e6."""
    rng = np.random.default_rng(1)
    data = Split(*(_side(rng, np.arange(ROWS) // 100) for _ in range(2)))
    pairs = [_pair(1e6 * rng.normal(size=(ROWS, 2)), ROWS), _pair(rng.normal(size=(JOINTS * ROWS, 1)), 0)]
    dense = np.hstack([pair.fit.dense(JOINTS * ROWS) for pair in pairs])
    expected = np.linalg.lstsq(dense, data.fit.y, rcond=None)[0]
    found = fit_together(data, pairs)
    np.testing.assert_allclose(found.coefficients, expected, rtol=1e-9)
    np.testing.assert_allclose(found.residual.fit, data.fit.y - dense @ expected, atol=1e-11)
    np.testing.assert_allclose(found.residual.held_out, data.held_out.y - 2.0 * dense @ expected, atol=1e-11)
    np.testing.assert_allclose(found.basis.T @ found.basis, np.eye(3), atol=1e-10)


def test_dependent_columns_are_one_direction() -> None:
    """The same column twice, the second time with a ten-thousandth of another: half of the coefficient each."""
    rng = np.random.default_rng(2)
    data = Split(*(_side(rng, np.arange(ROWS) // 100) for _ in range(2)))
    x = rng.normal(size=(JOINTS * ROWS, 1))
    found = fit_together(data, [_pair(x, 0), _pair(x + 1e-4 * rng.normal(size=x.shape), 0)])
    alone = fit_together(data, [_pair(x, 0)])
    assert found.basis.shape[1] == 1
    np.testing.assert_allclose(found.coefficients, np.repeat(alone.coefficients / 2, 2), rtol=0.02)


def test_sums_over_blocks_are_of_all_joints() -> None:
    """Blocks of different lengths; one has no rows."""
    rng, block = np.random.default_rng(3), np.repeat([0, 1, 3, 4], [130, 70, 150, 50])
    side, values = _side(rng, block), rng.normal(size=JOINTS * ROWS)
    expected = [sum(values[np.tile(block, JOINTS) == number]) for number in range(5)]
    np.testing.assert_allclose(side.by_block(values), expected, atol=1e-12)
