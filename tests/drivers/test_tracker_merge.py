"""Edges and frames are paired right: lost edges, spikes, drifting clocks, frames missing in the file."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.tracker_stream.merge import align

FRAMES = 300


def run(seed: int, *, jitter: float, ppm: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edge times by one clock, frame numbers and times by another, drifting, one; both see the same jitter."""
    random = np.random.default_rng(seed)
    at = np.arange(1, FRAMES + 1) * 1e-3 + random.normal(0, jitter, FRAMES).clip(-2e-4, 2e-4)
    edges = 17.3 + at + random.normal(0, 1e-7, FRAMES)
    return edges, np.arange(1, FRAMES + 1), at * (1 + ppm * 1e-6) + random.normal(0, 3e-7, FRAMES)


@given(
    seed=st.integers(0, 10_000),
    lost=st.sets(st.integers(0, FRAMES - 1), max_size=12),
    spikes=st.sets(st.integers(0, FRAMES - 2), max_size=5),
    away=st.floats(0.3, 0.7),
    ppm=st.floats(-200, 200),
)
@settings(max_examples=60)
def test_lost_edges_and_spikes_never_shift_the_rest(
    seed: int, lost: set[int], spikes: set[int], away: float, ppm: float
) -> None:
    edges, number, seconds = run(seed, jitter=20e-6, ppm=ppm)
    truth = [(t, k) for k, t in enumerate(edges) if k not in lost]
    # Away from the even grid: a spike as near to the place of a lost edge as jitter brings edges is that edge, for all
    # one can tell.
    truth += [(17.3 + (k + 1 + away) * 1e-3, -1) for k in spikes]
    truth.sort()
    got = align(np.array([t for t, _ in truth]), number, seconds)
    assert got.certain
    assert got.frame.tolist() == [k for _, k in truth]


@pytest.mark.parametrize(("first", "last"), [(1, 0), (0, 1), (3, 2)])
def test_an_edge_lost_at_the_end_of_even_intervals_is_not_guessed(first: int, last: int) -> None:
    edges, number, seconds = run(5, jitter=0.0)
    got = align(edges[first : FRAMES - last], number, seconds)
    assert not got.certain
    assert "too even" in got.why


def test_even_intervals_with_all_edges_are_certain() -> None:
    edges, number, seconds = run(6, jitter=0.0)
    got = align(edges, number, seconds)
    assert got.certain and got.frame.tolist() == list(range(FRAMES))


def test_frames_missing_in_the_file_leave_edges_without_one() -> None:
    edges, number, seconds = run(7, jitter=20e-6)
    keep = np.setdiff1d(np.arange(FRAMES), [10, 11, 150])
    got = align(edges, number[keep], seconds[keep])
    assert np.flatnonzero(got.frame < 0).tolist() == [10, 11, 150]
    assert number[keep][got.frame[12:20]].tolist() == list(range(13, 21))


def test_a_tracker_that_stopped_early_leaves_the_last_edges_alone() -> None:
    edges, number, seconds = run(8, jitter=20e-6)
    got = align(edges, number[:200], seconds[:200])
    assert got.certain
    assert got.frame.tolist() == list(range(200)) + [-1] * 100


def test_a_line_that_is_not_the_trackers_is_refused() -> None:
    with pytest.raises(ValueError, match="few"):
        align(np.array([0.0, 1.0]), np.arange(5), np.arange(5.0))
