"""Recordings read with their rows averaged: against means computed plainly, across any division into chunks."""

from __future__ import annotations

import itertools
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from daq.recording.thinned import Thinned


def columns(rows: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(rows)
    quality = 1 << random.integers(0, 8, (rows, 3)).astype(np.uint8)
    q = random.normal(size=(rows, 2))
    return {"number": 5 + np.arange(rows), "q": q, "wall_ns": 1000 * np.arange(rows), "quality": quality}


def read(whole: dict[str, np.ndarray], edges: list[int], most: int) -> Thinned:
    thinned = Thinned(most)
    for start, stop in itertools.pairwise([0, *sorted(edges), len(whole["number"])]):
        thinned.append({name: values[start:stop] for name, values in whole.items()})
    return thinned


@given(st.integers(1, 300), st.lists(st.integers(0, 300), max_size=12), st.integers(2, 40))
def test_rows_are_means_whatever_the_chunks(rows: int, edges: list[int], most: int) -> None:
    whole = columns(rows)
    thinned = read(whole, [min(edge, rows) for edge in edges], most)
    found, factor = thinned.arrays(), thinned.factor
    groups = rows // factor
    assert len(found["q"]) == groups <= most
    assert factor == 1 or rows > most // 2 * 2 * (factor // 2), "no more is averaged than need be"
    kept = groups * factor
    assert np.allclose(found["q"], whole["q"][:kept].reshape(groups, factor, 2).mean(axis=1))
    assert np.all(np.abs(found["wall_ns"] - whole["wall_ns"][:kept].reshape(groups, factor).mean(axis=1)) <= factor)
    assert np.array_equal(found["number"], whole["number"][:kept:factor])
    bits = np.bitwise_or.reduce(whole["quality"][:kept].reshape(groups, factor, 3), axis=1)
    assert np.array_equal(found["quality"], bits)


def test_missing_samples_and_missing_rows() -> None:
    whole = columns(16)
    whole["q"][3, 0] = whole["q"][8, 1] = whole["q"][9, 1] = np.nan
    whole["number"][11:] += 7  # rows 11 to 17 were lost: the pair (10, 11) stands apart
    found = read(whole, [], 8).arrays()["q"]
    assert found[1, 0] == whole["q"][2, 0], "the sample that is there"
    assert np.isnan(found[4, 1])
    assert np.array_equal(found[5], whole["q"][10]), "no mean over a gap"


def test_a_short_recording_takes_no_memory_for_a_long_one() -> None:
    """Five seconds of one joint reserved 3.4 GB, which a limit on memory refused."""
    whole = columns(1000)
    tracemalloc.start()
    try:
        read(whole, [400], 20_000_000)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def test_a_recording_that_fits_is_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    random = np.random.default_rng(0)
    t, q, i = np.arange(5000) / 1000, random.normal(size=(5000, 2)), random.normal(size=(5000, 2))
    write_table(path, t, {"q": q, "i": i}, Attachments(), extra={"oil": q[:, 0]})
    plain, within = open_recording(path), open_recording(path, most_numbers=10_000)
    assert within.averaged == 1 and np.array_equal(within.q, plain.q) and np.array_equal(within.t, plain.t)
    thinned = open_recording(path, most_numbers=9_998)
    assert thinned.averaged == 2 and len(thinned) == 2500 and thinned.dt == pytest.approx(0.002)
    assert np.allclose(thinned.i, i.reshape(2500, 2, 2).mean(axis=1))
    assert thinned.ledger == plain.ledger and thinned.gaps == [] and thinned.extra == {}
