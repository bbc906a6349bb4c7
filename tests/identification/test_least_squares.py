"""Fits against scipy, and standard deviations against the spread of repeated experiments with coloured noise."""

from __future__ import annotations

import numpy as np
from scipy import signal

from identification.regression.equations import Equations
from identification.regression.least_squares import joint_triangles, least_squares, relative_error, weighted_by_joint
from identification.regression.uncertainty import correlation_time, fit_uncertainty


def rows(noise: np.ndarray, columns: np.ndarray, truth: np.ndarray) -> Equations:
    n = len(noise)
    torque = columns @ truth + noise
    index = np.zeros(n, np.intp)
    return Equations(columns, torque, index, index, np.arange(n) / 20, ("a", "b", "c"))


def design(n: int) -> np.ndarray:
    t = np.arange(n) / 20
    return np.stack([np.sin(2.1 * t), np.sign(np.sin(0.7 * t)), np.ones(n)], axis=1)


def coloured(random: np.random.Generator, n: int) -> np.ndarray:
    return signal.lfilter([1], [1, -0.9], random.standard_normal(n + 200))[200:]


def test_ols_is_numpys() -> None:
    random = np.random.default_rng(0)
    columns, y = random.standard_normal((200, 5)), random.standard_normal(200)
    fit = least_squares(columns, y, np.zeros(200, np.intp), "ols")
    assert np.allclose(fit.values, np.linalg.lstsq(columns, y, rcond=None)[0])
    assert np.isclose(relative_error(y, fit.residual), np.linalg.norm(fit.residual) / np.linalg.norm(y))


def test_wls_listens_to_the_quiet_joint() -> None:
    random = np.random.default_rng(1)
    joint = np.repeat([0, 1], 500)
    columns = random.standard_normal((1000, 2))
    y = columns @ [1.0, 2.0] + np.where(joint == 0, 0.01, 3.0) * random.standard_normal(1000)
    error = {m: np.max(np.abs(least_squares(columns, y, joint, m).values - [1.0, 2.0])) for m in ("ols", "wls")}
    assert error["wls"] < 0.1 * error["ols"]


def test_irls_shrugs_off_what_plain_least_squares_believes() -> None:
    random = np.random.default_rng(2)
    columns = random.standard_normal((400, 2))
    y = columns @ [1.0, 2.0] + 0.05 * random.standard_normal(400)
    y[:40] += 20
    joint = np.zeros(400, np.intp)
    assert np.max(np.abs(least_squares(columns, y, joint, "irls").values - [1.0, 2.0])) < 0.02
    assert np.max(np.abs(least_squares(columns, y, joint, "wls").values - [1.0, 2.0])) > 0.05


def test_stated_deviations_are_the_spread_of_repeated_experiments() -> None:
    random, truth, n = np.random.default_rng(3), np.array([1.0, 0.5, -0.2]), 1500
    columns = design(n)
    values, stated, formula, bootstrap = [], [], [], []
    for k in range(120):
        equations = rows(coloured(random, n), columns, truth)
        fit = least_squares(columns, equations.torque, equations.joint, "ols")
        uncertainty = fit_uncertainty(columns, equations, fit)
        values.append(fit.values)
        stated.append(uncertainty.std)
        formula.append(uncertainty.std_formula)
        if k < 20:
            bootstrap.append(uncertainty.std_bootstrap)
    actual = np.std(values, axis=0)
    inside = np.abs(np.array(values) - truth) < 2 * np.array(stated)
    assert inside.mean() > 0.9
    assert np.all(np.mean(stated, axis=0) < 1.6 * actual)
    assert np.all(np.mean(formula, axis=0)[1:] < 0.6 * actual[1:])  # what the textbook formula would have claimed
    ratio = np.mean(bootstrap, axis=0) / np.mean(stated, axis=0)
    assert np.all((ratio > 0.6) & (ratio < 1.2))


def test_correlation_time_of_a_first_order_process() -> None:
    random = np.random.default_rng(4)
    noise = coloured(random, 40_000)
    expected = (1 + 0.9) / (1 - 0.9) / 20
    assert 0.7 * expected < correlation_time(np.arange(len(noise)) / 20, noise) < 1.4 * expected


def test_triangles_of_joints_stand_for_all_rows() -> None:
    random = np.random.default_rng(6)
    columns, joint = random.standard_normal((300, 8)), random.integers(0, 3, 300)
    columns[joint == 2, :5] = 0.0  # as torques of the last joint know nothing of the links before it
    y = random.standard_normal(300)
    parts = joint_triangles(columns, y, joint)
    assert len(parts.columns) < 9 + 9 + 5
    assert np.allclose(parts.columns.T @ parts.columns, columns.T @ columns)
    noise = [np.std(y[joint == j]) for j in range(3)]
    fit = weighted_by_joint(columns, y, joint, parts)
    assert (
        np.allclose(1 / fit.weight[joint == 1], fit.weight[joint == 1][0] ** -1)
        and 0.8 < noise[1] * fit.weight[joint == 1][0] < 1.2
    )
    by_hand = np.linalg.lstsq(columns * fit.weight[:, None], y * fit.weight, rcond=None)
    assert np.allclose(fit.values, by_hand[0])
    scaled = columns * fit.weight[:, None]
    assert np.isclose(fit.condition, np.linalg.cond(scaled / np.linalg.norm(scaled, axis=0)))


def test_blocks_that_agree_by_chance_are_no_surer_than_white_noise() -> None:
    """Errors of alternate sign cancel in every block: the blocks do not scatter at all."""
    n = 1200
    equations = rows((-1.0) ** np.arange(n), np.ones((n, 1)), np.array([2.0]))
    fit = least_squares(equations.columns, equations.torque, equations.joint, "ols")
    uncertainty = fit_uncertainty(equations.columns, equations, fit)
    np.testing.assert_allclose(uncertainty.std_formula, 1 / np.sqrt(n), rtol=0.01)
    np.testing.assert_allclose(uncertainty.std, uncertainty.std_formula)
    np.testing.assert_allclose(np.sqrt(np.diag(uncertainty.covariance)), uncertainty.std)
