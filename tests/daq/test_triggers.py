"""Indices from numbers and intervals.

Random lines with missed and extra edges, jitter, drift, and any cut into batches.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.acquisition.join import nearest
from daq.acquisition.trigger_index import SETTLE, Indexer


def _card(seed: int, edges: int, missed: list[int], jitter: float, drift: float, ticks: bool) -> tuple[np.ndarray, ...]:
    """True edge, number, host and tick of the rows of a card that misses some edges; period 1 ms."""
    random = np.random.default_rng(seed)
    true = np.setdiff1d(np.arange(edges), missed)
    host = 10**15 + true * 1e6 * (1 + drift) + random.uniform(-jitter, jitter, len(true)) * 1e6
    tick = np.round(host * 0.04).astype(np.int64) if ticks else np.zeros(len(true), np.int64)
    return true, np.arange(len(true)), np.round(host).astype(np.int64), tick


def _run(indexer: Indexer, rows: tuple[np.ndarray, ...], cuts: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Indices of all rows, given in batches of the sizes of ``cuts`` (over and over); and which were kept."""
    indices, kept, done, given_ = [], [], 0, 0
    turn = 0
    while done < len(rows[0]):
        given_ = min(given_ + cuts[turn % len(cuts)], len(rows[0]))
        turn += 1
        final = given_ == len(rows[0])
        index, keep = indexer.index(*(column[done:given_] for column in rows), final=final)
        assert not final or len(index) == given_ - done
        indices.append(index)
        kept.append(keep)
        done += len(index)
    return np.concatenate(indices), np.concatenate(kept)


@given(
    seed=st.integers(0, 1000),
    gaps=st.lists(st.integers(SETTLE, 40), max_size=6),
    widths=st.lists(st.integers(1, 4), min_size=6, max_size=6),
    jitter=st.floats(0, 0.12),
    drift=st.floats(-2e-3, 2e-3),
    ticks=st.booleans(),
    cuts=st.lists(st.integers(1, 60), min_size=1, max_size=5),
)
def test_missed_edges_are_found_wherever_the_batches_are_cut(
    seed: int, gaps: list[int], widths: list[int], jitter: float, drift: float, ticks: bool, cuts: list[int]
) -> None:
    missed, at = [], 20
    for gap, width in zip(gaps, widths):
        at += gap
        missed += range(at, at + width)
        at += width
    true, *rows = _card(seed, at + 30, missed, jitter, drift, ticks)
    indexer = Indexer(1e6)
    index, keep = _run(indexer, tuple(rows), cuts)
    assert np.array_equal(index, true)
    assert keep.all()
    assert indexer.missed == set(missed)


def test_a_row_stamped_late_is_no_missed_edge() -> None:
    true, number, host, tick = _card(0, 200, [], 0.02, 0.0, False)
    for row in (50, 51, 99, 120):
        host[row] += 1_400_000
    for cuts in ([200], [10], [1], [17, 3]):
        indexer = Indexer(1e6)
        index, keep = _run(indexer, (number, host, tick), cuts)
        assert np.array_equal(index, true)
        assert keep.all()
        assert not indexer.missed


@pytest.mark.parametrize("cut", [1, 7, 10, 300])
def test_an_extra_edge_does_not_shift_the_rows_after_it(cut: int) -> None:
    true, _, host, tick = _card(0, 200, [], 0.02, 0.0, False)
    at = 77
    host = np.insert(host, at + 1, host[at] + 500_000)
    true = np.insert(true, at + 1, -1)
    indexer = Indexer(1e6)
    index, keep = _run(indexer, (np.arange(201), host, np.append(tick, 0)), [cut])
    assert np.array_equal(index[keep], true[true >= 0])
    assert np.array_equal(keep, true >= 0)  # of the two rows on one index, the one that lies on the grid
    assert indexer.extra == 1


def test_a_gap_of_numbers_is_a_lost_row_and_no_missed_edge() -> None:
    true, _, host, tick = _card(0, 200, [90, 91], 0.05, 0.0, False)
    indexer = Indexer(1e6)
    index, _ = _run(indexer, (true, host, tick), [10])
    assert np.array_equal(index, true)
    assert not indexer.missed


def test_stamps_of_the_arrival_cannot_show_a_missed_edge_and_are_not_taken_for_one() -> None:
    number = np.arange(300)
    host = 10**15 + (number // 10 + 1) * 10_000_000
    indexer = Indexer(1e6)
    index, _ = _run(indexer, (number, host, np.zeros(300, np.int64)), [10])
    assert np.array_equal(index, number)
    assert indexer.regular is False


def test_stamps_that_are_uneven_at_first_show_missed_edges_later() -> None:
    """A SYNC of CANopen bears no number: of a busy start nobody knows, from the first even rows on a gap is an edge."""
    true, number, host, tick = _card(5, 400, [250, 251, 330], 0.02, 0.0, True)
    host = host.copy()
    host[:8] += np.array([0, 9, 3, 8, 0, 7, 2, 6]) * 100_000
    indexer = Indexer(1e6, numbered=False)
    index, _ = _run(indexer, (np.full(len(number), -1), host, np.zeros_like(tick)), [10])
    assert indexer.regular and 64 <= indexer.unguarded < 90
    assert np.array_equal(index, true) and indexer.missed == {250, 251, 330}


def test_rows_without_numbers_are_counted_and_their_gaps_found() -> None:
    true, number, host, tick = _card(3, 200, [60, 61, 150], 0.05, 5e-4, True)
    indexer = Indexer(1e6, numbered=False)
    index, _ = _run(indexer, (np.full(len(number), -1), host, tick), [13])
    assert np.array_equal(index, true)
    assert indexer.missed == {60, 61, 150}


def test_a_value_counts_as_fresh_for_one_trigger_only() -> None:
    """Values at 10 and 30 ms and triggers every 10 ms: each is that of its nearest trigger, and a repeat elsewhere."""
    values, triggers = np.array([10, 30]), np.array([0, 10, 20, 30, 40])
    place, fresh = nearest(values, triggers)
    np.testing.assert_array_equal(values[place][[0, 1, 3, 4]], [10, 10, 30, 30])
    np.testing.assert_array_equal(fresh, [False, True, False, True, False])
    # in the next block, the value that has been served is none of its own
    np.testing.assert_array_equal(nearest(values[1:], triggers[3:], served=29)[1], [True, False])
    np.testing.assert_array_equal(nearest(values[1:], triggers[4:], served=30)[1], [False])
