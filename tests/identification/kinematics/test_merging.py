"""A separately recorded tracker file put to the run's triggers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from identification.kinematics.data.tracker_file import TrackerFile, merge, read_tracker


def events(seed: int, n: int, jitter: float) -> np.ndarray:
    return np.cumsum(1e-3 + jitter * np.random.default_rng(seed).normal(size=n))


def tracker_of(when: np.ndarray, drift: float, offset: float) -> TrackerFile:
    number = np.arange(len(when), dtype=float)
    return TrackerFile("tracker.csv", offset + (1 + drift) * when, np.column_stack((number, number, number)))


@settings(max_examples=30)
@given(
    seed=st.integers(0, 10**6),
    drift=st.floats(-2e-5, 2e-5),
    lost_edges=st.integers(0, 6),
    unkept=st.integers(0, 6),
    late_start=st.integers(0, 8),
)
def test_every_row_gets_its_own_sample(seed: int, drift: float, lost_edges: int, unkept: int, late_start: int) -> None:
    """Edges lost by the run, samples not kept by the tracker, rows before its first sample, two clocks.

    Still the same events.
    """
    generator = np.random.default_rng(seed)
    when = events(seed, 1200, 2e-5)
    edges = np.delete(np.arange(1200), generator.choice(np.arange(20, 1200), lost_edges, replace=False))
    samples = np.delete(np.arange(1200), generator.choice(np.arange(20, 1200), unkept, replace=False))[late_start:]
    tracker = tracker_of(when, drift, 77.0)
    kept = TrackerFile("t", tracker.t[samples], tracker.xyz[samples])
    found = merge(when[edges] + 2e-7 * generator.normal(size=len(edges)), kept)
    points = found.points(kept)[:, 0]
    matched = found.sample >= 0
    np.testing.assert_array_equal(points[matched], edges[matched])
    both = np.isin(edges, samples).sum()
    assert matched.sum() == both
    assert found.sure


def test_a_pause_is_a_signature_too() -> None:
    when = np.arange(800) * 1e-3
    when[300:] += 0.0123
    tracker = tracker_of(when, 0.0, 5.0)
    found = merge(when[4:], tracker)
    np.testing.assert_array_equal(found.sample, np.arange(4, 800))


def test_perfectly_even_times_are_told_to_be_no_proof() -> None:
    when = np.arange(500) * 1e-3
    found = merge(when, tracker_of(when, 0.0, 5.0))
    np.testing.assert_array_equal(found.sample, np.arange(500))
    assert not found.sure


def test_another_rate_is_refused() -> None:
    when = events(1, 500, 1e-5)
    with pytest.raises(InputError, match="not the same triggers"):
        merge(when, tracker_of(2 * when, 0.0, 0.0))


def test_files_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "tracker.csv"
    path.write_text("t,x,y,z\n0.0,1,2,3\n0.001,,,\n0.002,nan,2,3\n")
    file = read_tracker(path)
    np.testing.assert_array_equal(file.xyz[0], [1, 2, 3])
    assert np.isnan(file.xyz[1]).all()
    for text, reason in (
        ("a,b\n1,2\n", "no column 't'"),
        ("", "no column 't'"),
        ("t,x,y,z\n0,1,2,3\n0,1,2,3\n", "line 3: column t"),
        ("t,x,y,z\n0,1,2,oops\n", "line 2: 'oops'"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=reason):
            read_tracker(path)
    with pytest.raises(InputError, match="no such file"):
        read_tracker(tmp_path / "absent.csv")
