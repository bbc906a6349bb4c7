"""Which hypothesis enters the joint fit, on rows made by hand: what is certain is not always what changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from comparison.from_recordings import _alternatives
from comparison.joint_fit import tested
from comparison.joint_fit.effects import Added
from comparison.joint_fit.fewest_changes import AcceptedChange
from comparison.joint_fit.hypotheses import Hypothesis
from comparison.joint_fit.joint_regression import JointRegression
from comparison.joint_fit.selection import selected, with_one_mass

RECORDINGS, BLOCKS, ROWS = 8, 30, 12
QUIET = 8
"""Values of the kind of the second whose scatter says that recordings hardly differ in it."""


def both_of(
    rng: np.random.Generator, made: tuple[float, float, float], differs: float
) -> tuple[JointRegression, list[Hypothesis]]:
    """Eight recordings, the last four with changes of the first three values, under noise of 1.

    The rows of the second value are a part of those of the first. What a change of the first makes of the others
    differs between recordings by ``differs`` of it, as of a cause that the columns describe to first order only.
    """
    n, size = RECORDINGS * BLOCKS * ROWS, 3 + QUIET
    x, in_part = rng.normal(size=(n, size)), np.arange(n) % 3 == 0
    x[:, 1] = np.where(in_part, x[:, 0], 0.0)
    block = np.repeat(np.arange(RECORDINGS * BLOCKS), ROWS)
    recording = np.repeat(np.arange(RECORDINGS), BLOCKS)
    after = recording[block] >= RECORDINGS // 2
    uneven = differs * made[0] * (-1.0) ** recording[block] * x[:, 0] * ~in_part
    y = rng.normal(size=n) + after * (x[:, :3] @ made + uneven)
    fit = JointRegression(
        x,
        y,
        block,
        recording,
        recording >= RECORDINGS // 2,
        np.ones(size),
        np.zeros((size, 0)),
    )
    names = ["cause", "part", "other", *(f"quiet {k}" for k in range(QUIET))]
    kinds = ["scale", *["friction"] * (size - 1)]
    every = [Hypothesis(what, 1, one[:, None], name, tries=300) for what, one, name in zip(kinds, np.eye(size), names)]
    return fit, every


def names(found: list[tested.Tested]) -> set[str]:
    return {one.hypothesis.quantity for one in found}


@pytest.mark.parametrize("seed", range(4))
def test_a_cause_is_found_though_a_part_of_it_is_surer(seed: int) -> None:
    fit, every = both_of(np.random.default_rng(seed), (1.0, 0.0, 0.0), 0.17)
    whole, part, *_ = tested.tested(fit, every, [])
    assert whole.gain > part.gain and whole.log_p > part.log_p
    (found,) = selected(fit, every)
    assert found.hypothesis.quantity == "cause"
    # something changed as surely as its part shows
    assert found.log_p <= part.log_p


@pytest.mark.parametrize("seed", range(4))
def test_a_part_alone_is_found_as_itself(seed: int) -> None:
    fit, every = both_of(np.random.default_rng(seed), (0.0, 1.0, 0.0), 0.0)
    assert names(selected(fit, every)) == {"part"}


@pytest.mark.parametrize("seed", range(4))
def test_two_that_have_nothing_in_common_are_both_found(seed: int) -> None:
    fit, every = both_of(np.random.default_rng(seed), (1.0, 0.0, 0.5), 0.17)
    assert names(selected(fit, every)) == {"cause", "other"}


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_found_where_nothing_changed(seed: int) -> None:
    fit, every = both_of(np.random.default_rng(seed), (0.0, 0.0, 0.0), 0.0)
    assert selected(fit, every) == []


@pytest.mark.parametrize(("joint", "size", "expected"), [(1, 0.5, {"cause"}), (2, 0.5, {"cause", "other"})])
def test_what_the_law_of_an_effect_may_be_wrong_by_is_no_change(joint: int, size: float, expected: set[str]) -> None:
    """A hundredth of the squares that a ripple explains: at its own joint, though sure, an error of its law."""
    fit, every = both_of(np.random.default_rng(3), (5.0, 0.0, size), 0.0)
    ripple = replace(every[0], what="effect beyond the model", added=Added("gear_ripple", 1, {"order": 1.0}))
    every = [ripple, every[1], replace(every[2], joint=joint), *every[3:]]
    assert names(selected(fit, every)) == expected


@pytest.mark.parametrize(("sign", "expected"), [(1.0, {"mass"}), (-1.0, {"cause", "other"})])
def test_a_mass_takes_the_place_of_several_that_it_explains(sign: float, expected: set[str]) -> None:
    fit, every = both_of(np.random.default_rng(1), (0.3, 0.0, sign * 0.3), 0.0)
    mass = Hypothesis("inertia", 1, np.eye(len(fit.scale))[:, [0, 2]].sum(axis=1, keepdims=True), "mass")
    found = selected(fit, every)
    assert names(found) == {"cause", "other"}
    assert names(with_one_mass(fit, every, [mass], found)) == expected


@pytest.mark.parametrize("seed", range(3))
def test_a_mass_is_judged_beside_what_changed_with_it(seed: int) -> None:
    """A larger change of another value is noise to it, until that one is in the fit."""
    fit, every = both_of(np.random.default_rng(seed), (0.4, 0.0, 0.4), 0.0)
    fit = replace(fit, y=fit.y + np.where(fit.rows_after, 40.0 * fit.x[:, 3], 0.0))
    mass = Hypothesis("inertia", 1, np.eye(len(fit.scale))[:, [0, 2]].sum(axis=1, keepdims=True), "mass")
    (alone,) = (one for one in tested.tested(fit, [*every, mass], []) if one.hypothesis is mass)
    assert alone.log_p > np.log(1e-3)
    found = selected(fit, every)
    assert names(found) == {"cause", "other", "quiet 0"}
    assert names(with_one_mass(fit, every, [mass], found)) == {"mass", "quiet 0"}


def test_rivals_are_told_once_and_none_is_the_change_itself() -> None:
    """A body and a mass at a point of its link have the same words."""
    fit, every = both_of(np.random.default_rng(1), (1.0, 0.0, 0.0), 0.0)
    body = Hypothesis("inertia", 2, np.eye(len(fit.scale))[:, :4])
    point = replace(body, directions=body.directions[:, :2])
    (found,) = selected(fit, every)
    accepted = AcceptedChange(replace(found, hypothesis=body), frozenset(), [point, *every[2:3], *every[2:3]])
    assert list(_alternatives([accepted])) == [f"body of link 2 from {every[2].words}"]
    assert list(_alternatives([replace(accepted, rivals=[point])])) == []


def test_a_variance_that_is_known_leaves_no_doubt_of_few_recordings() -> None:
    """Of a change that scatters little between recordings, beside what differs from day to day anyhow."""
    fit, every = both_of(np.random.default_rng(0), (1.0, 0.0, 0.0), 0.17)
    drifting = replace(fit, drift=0.2 * np.eye(len(fit.scale))[:, :1])
    few, known = (tested.tested(one, every, [])[0] for one in (fit, drifting))
    size, std = float(few.changes[0]), float(np.sqrt(few.covariance[0, 0]))
    assert std < 0.1 and few.log_p > np.log(2.0 * stats.t.sf(size / std, 10))
    z = float(known.changes[0] / np.sqrt(known.covariance[0, 0]))
    assert 4.0 < z < 6.0 and known.log_p == pytest.approx(np.log(2.0 * stats.norm.sf(z)), abs=0.5)


@pytest.mark.parametrize("of_each_side", [1, RECORDINGS // 2])
def test_a_hypothesis_is_judged_alone_as_beside_all_others(of_each_side: int) -> None:
    """Only the scatter of its kind between recordings is shared, and one recording of each side shows none."""
    fit, every = both_of(np.random.default_rng(3), (1.0, 0.5, 0.3), 0.1)
    fit = replace(fit, recording=fit.recording * 2 * of_each_side // RECORDINGS)
    given = every[:1]
    for one, expected in zip(every[1:], tested.tested(fit, every[1:], given), strict=True):
        (alone,) = tested.tested_alone(fit, one, every, given)
        assert alone.hypothesis is one and alone.log_p == pytest.approx(expected.log_p, rel=1e-9)
        assert alone.covariance == pytest.approx(expected.covariance, rel=1e-9)


def test_pieces_of_rows_are_all_rows() -> None:
    """Columns that are zero in some rows are left out of these."""
    fit, _ = both_of(np.random.default_rng(6), (1.0, 0.5, 0.3), 0.0)
    x = fit.x.copy()
    x[: len(x) // 3, 3:] = 0.0
    fit, after = replace(fit, x=x), fit.rows_after
    assert fit.total == pytest.approx(x.T @ x, abs=1e-9)
    assert fit.total_after == pytest.approx(x[after].T @ x[after], abs=1e-9)
    sides = fit.beside_shared(np.arange(1.0, 1.0 + x.shape[1]))
    rows = np.concatenate([piece.of(sides) for piece in fit.pieces])
    assert rows == pytest.approx(np.where(after, x @ sides[1], x @ sides[0]), abs=1e-9)
    counted = np.zeros(len(fit.recording))
    for piece in fit.pieces:
        counted[piece.blocks] += piece.sums @ np.ones(len(piece.x))
    assert counted == pytest.approx(np.bincount(fit.block), abs=0.0)
    assert min(len(piece.columns) for piece in fit.pieces) < x.shape[1]


def test_a_change_explains_what_least_squares_of_all_rows_explain() -> None:
    fit, every = both_of(np.random.default_rng(5), (1.0, 0.5, 0.3), 0.0)
    change = every[0].directions
    rows = np.column_stack([fit.x, np.where(fit.rows_after[:, None], fit.x @ change, 0.0)])
    left = fit.y - rows @ np.linalg.lstsq(rows, fit.y, rcond=None)[0]
    (found,) = tested.tested(fit, every[:1], [])
    assert np.concatenate(tested.residuals_of(fit, [found])) == pytest.approx(left, abs=1e-6)
    every_column = np.arange(len(fit.scale))
    explained = fit.explained(every_column, change, fit.moment, fit.moment_after)
    assert explained == pytest.approx(fit.y @ fit.y - left @ left, rel=1e-9)
    # of fewer columns, less
    rows = rows[:, 1:]
    left = fit.y - rows @ np.linalg.lstsq(rows, fit.y, rcond=None)[0]
    assert fit.explained(every_column[1:], change, fit.moment, fit.moment_after) == pytest.approx(
        fit.y @ fit.y - left @ left, rel=1e-9
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_cause_of_many_coefficients_is_none_where_one_leaves_chance_of_it(seed: int) -> None:
    """Coefficients of their own explain noise that is larger in slow motions than that of all rows."""
    fit, every = both_of(np.random.default_rng(seed), (1.0, 0.0, 0.0), 0.0)
    slow = np.random.default_rng(seed).normal(size=len(np.unique(fit.block)))[fit.block]
    x = fit.x.copy()
    x[:, 3:] = np.random.default_rng(9).normal(size=(RECORDINGS * BLOCKS, QUIET))[fit.block]
    fit = replace(fit, x=x, y=fit.y + slow)
    body = Hypothesis("inertia", 1, np.eye(len(fit.scale))[:, [0, *range(3, 3 + QUIET)]])
    every = [*every, body]
    whole, one = tested.tested(fit, [body, every[0]], [])
    assert whole.gain - 2 * (1 + QUIET) > one.gain - 2
    assert names(selected(fit, every)) == {"cause"}
