"""Standard deviations of coefficients where residuals are correlated within clusters."""

from __future__ import annotations

import numpy as np
import pytest

from identification.selection.cluster_covariance import cluster_covariance
from identification.selection.least_squares import scaled_lstsq


def test_with_a_cluster_per_row_it_is_whites_estimator() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=(400, 3)) * [1.0, 1e4, 1e-3]
    e = rng.normal(size=400) * rng.uniform(0.5, 2.0, 400)
    inverse = np.linalg.inv(x.T @ x)
    white = inverse @ (x * e[:, None] ** 2).T @ x @ inverse * 400 / 397
    np.testing.assert_allclose(cluster_covariance(x, [e], np.arange(400)), white, rtol=1e-6)


@pytest.mark.parametrize("clusters", [12, 60])
def test_std_is_the_scatter_of_fits_to_correlated_residuals(clusters: int) -> None:
    """Errors that are constant within a cluster, as columns are.

    The textbook formula is too small by a factor of several.
    """
    rng = np.random.default_rng(2)
    cluster = np.repeat(np.arange(clusters), 30)
    x = np.column_stack(
        [np.ones(len(cluster)), rng.normal(size=clusters)[cluster] + 0.3 * rng.normal(size=len(cluster))]
    )
    found, stated, textbook = [], [], []
    for _ in range(400):
        y = x @ [1.0, 2.0] + rng.normal(size=clusters)[cluster] + 0.2 * rng.normal(size=len(cluster))
        c = scaled_lstsq(x, y)
        e = y - x @ c
        found.append(c)
        stated.append(np.sqrt(np.diag(cluster_covariance(x, [e], cluster))))
        textbook.append(np.sqrt(np.diag(np.linalg.inv(x.T @ x)) * np.mean(e**2)))
    scatter = np.std(found, axis=0)
    assert np.mean(stated, axis=0) == pytest.approx(scatter, rel=0.25)
    assert np.all(np.mean(textbook, axis=0) < 0.4 * scatter)


def test_errors_that_are_independent_add_up() -> None:
    rng = np.random.default_rng(3)
    x, cluster = rng.normal(size=(300, 2)), np.arange(300) // 10
    one, other = rng.normal(size=300), rng.normal(size=300)
    both = cluster_covariance(x, [one, other], cluster)
    np.testing.assert_allclose(both, cluster_covariance(x, [one], cluster) + cluster_covariance(x, [other], cluster))


def test_a_direction_without_data_has_the_std_that_is_given() -> None:
    rng = np.random.default_rng(4)
    a = rng.normal(size=(200, 1))
    x = np.hstack([a, a])
    e, cluster = rng.normal(size=200), np.arange(200) // 10
    alone = cluster_covariance(x, [e], cluster)
    given = cluster_covariance(x, [e], cluster, unknown=np.array([3.0, 3.0]))
    # the difference of the two coefficients is what the data does not show
    across = np.array([1.0, -1.0]) / np.sqrt(2)
    assert across @ alone @ across == pytest.approx(0.0, abs=1e-12)
    assert across @ given @ across == pytest.approx(9.0, rel=1e-6)


def test_a_column_that_acts_in_few_clusters_is_as_uncertain_as_errors_of_the_given_variance_make_it() -> None:
    """It follows the errors of these clusters: their scores are next to nothing, and so is the sandwich."""
    rng = np.random.default_rng(5)
    cluster = np.repeat(np.arange(30), 40)
    x = np.column_stack([rng.normal(size=len(cluster)), np.where(cluster == 7, 1.0, 0.0)])
    found, bare, stated = [], [], []
    for _ in range(200):
        e = rng.normal(size=len(cluster))
        c = scaled_lstsq(x, e)
        left = e - x @ c
        found.append(c)
        bare.append(np.sqrt(np.diag(cluster_covariance(x, [left], cluster))))
        alike = np.full(len(cluster), np.mean(left**2))
        stated.append(np.sqrt(np.diag(cluster_covariance(x, [left], cluster, variance=alike))))
    scatter = np.std(found, axis=0)
    assert np.mean(bare, axis=0)[1] < 0.1 * scatter[1]
    assert np.mean(stated, axis=0)[1] == pytest.approx(scatter[1], rel=0.2)
    # of a column that acts everywhere, both say the same
    assert scatter[0] < np.mean(stated, axis=0)[0] < 1.6 * scatter[0]
