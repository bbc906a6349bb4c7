"""The judges of a cause: block scores under coloured noise, false-discovery control, projections."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal, stats

from diagnosis.selection.aliasing import confusability, span_of
from identification.selection.cluster_covariance import numbered_on
from identification.selection.significance import DRAWS, memory, p_of_short_blocks, p_value, shift_p_value


def _coloured(rng: np.random.Generator, seconds: float, correlation: float, rate: float = 100.0) -> np.ndarray:
    a = np.exp(-1.0 / (correlation * rate))
    return signal.lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=int(seconds * rate)))


def test_block_scores_keep_their_level_where_independent_samples_would_not() -> None:
    """Absent effects in noise correlated over 0.2 s.

    Tests on samples find half of them, block scores the stated share.
    """
    rng = np.random.default_rng(1)
    by_sample, by_block = [], []
    block = np.arange(6000) // 100
    for _ in range(300):
        noise, column = _coloured(rng, 60, 0.2), _coloured(rng, 60, 0.2)
        products = noise * column
        by_sample.append(stats.norm.sf(products.sum() / np.sqrt(np.sum(products**2))))
        by_block.append(p_value(np.bincount(block, weights=products)))
    assert np.mean(np.array(by_sample) < 0.05) > 0.2
    assert np.mean(np.array(by_block) < 0.05) < 0.09


def test_few_blocks_never_look_certain() -> None:
    assert p_value(np.array([5.0])) == pytest.approx(0.5, rel=1e-3)
    assert p_value(np.full(8, 3.0)) == pytest.approx(0.5**8, rel=1e-3)
    assert p_value(np.array([1.0, -2.0])) == 1.0


@settings(max_examples=25)
@given(st.lists(st.integers(-100, 300).filter(bool), min_size=2, max_size=9))
def test_p_values_are_never_smaller_than_the_exact_ones(gains: list[int]) -> None:
    values = np.array(gains) / 100
    signs = np.array(list(itertools.product((-1, 1), repeat=len(values))))
    exact = np.mean(signs @ np.abs(values) >= values.sum() - 1e-9)
    assert p_value(values) >= exact * (1 - 1e-3) or values.sum() <= 0


def test_blocks_of_several_recordings_are_numbered_one_after_the_other() -> None:
    blocks = [np.array([0, 0, 1]), np.array([0, 2]), np.array([0])]
    assert numbered_on(blocks).tolist() == [0, 0, 1, 2, 4, 5]


@pytest.mark.parametrize("correlation", [0.02, 0.1, 0.5])
def test_short_blocks_keep_their_level_whatever_the_memory_of_the_noise(correlation: float) -> None:
    """12 s in which an absent effect gains or loses by chance."""
    rng, p = np.random.default_rng(3), []
    for _ in range(600):
        products = _coloured(rng, 12, correlation) * _coloured(rng, 12, 0.2)
        p.append(p_of_short_blocks([products], [products], 100))
    assert np.mean(np.array(p) < 0.05) < 0.05 and np.mean(np.array(p) < 0.01) < 0.01


def test_twelve_seconds_show_an_effect_that_one_second_blocks_cannot() -> None:
    rng, p = np.random.default_rng(4), []
    for _ in range(20):
        noise, column = _coloured(rng, 12, 0.02), _coloured(rng, 12, 0.2)
        residual, remaining = noise + 0.8 * column, noise + 0.1 * column
        fall = residual**2 - remaining**2
        p.append((p_value(np.add.reduceat(fall, np.arange(0, 1200, 100))), fall, remaining * (residual - remaining)))
    assert min(by_second for by_second, *_ in p) >= 2.0**-12 * 0.999
    assert np.median([p_of_short_blocks([fall], [products], 100) for _, fall, products in p]) < 1e-6


def test_the_memory_of_noise_of_first_order_is_twice_its_time_constant() -> None:
    rng = np.random.default_rng(5)
    assert memory([_coloured(rng, 600, 0.1) for _ in range(3)], 100) == pytest.approx(20.0, rel=0.1)
    assert memory([rng.normal(size=60000)], 100) == pytest.approx(1.0, abs=0.1)
    assert memory([np.ones(1000)], 100) == 100.0
    assert memory([np.zeros(1000)], 100) == 100.0


def _events(rows: int) -> np.ndarray:
    """(rows, 1) three events of 20 rows."""
    at = np.arange(rows)
    return sum((np.exp(-(((at - start) / 8.0) ** 2)) for start in (400, 1500, 2100)), np.zeros(rows))[:, None]


def test_events_at_other_times_gain_as_much_by_chance_alone() -> None:
    """In coloured noise, over two recordings: the level is kept, and what is really there is found."""
    rng, absent, there = np.random.default_rng(2), [], []
    for _ in range(200):
        noise = [_coloured(rng, 30, 0.2)[:, None] for _ in range(2)]
        predicted = [float(rng.normal()) * _events(3000), np.zeros((3000, 1))]
        absent.append(shift_p_value(predicted, noise))
        there.append(shift_p_value([4.0 * _events(3000)] * 2, [one + 4.0 * _events(3000) for one in noise]))
    assert np.mean(np.array(absent) < 0.05) < 0.09
    # counted over so many shifts, a chance is not known to be smaller
    assert np.median(there) < 1e-3 and min(there) >= 1 / (1 + DRAWS)


def test_a_prediction_that_is_larger_than_the_residual_gains_nothing() -> None:
    assert shift_p_value([3.0 * _events(3000)], [_events(3000)]) == 1.0


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_only_what_is_outside_of_the_span_is_left(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, other = rng.normal(size=(200, 4)), rng.normal(size=200)
    span = span_of(columns)
    assert np.linalg.norm(span.remove(columns @ rng.normal(size=4))) < 1e-10
    left = other - columns @ np.linalg.lstsq(columns, other, rcond=None)[0]
    np.testing.assert_allclose(span.remove(other), left, atol=1e-12)
    alike = left + columns @ rng.normal(size=4)
    assert confusability(span, left[:, None], alike[:, None]) == pytest.approx(1.0)
