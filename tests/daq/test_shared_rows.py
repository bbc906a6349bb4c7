"""Copies and parts of a recording are known by their rows; a motion that is recorded twice is no copy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.recording import Attachments, Recording, open_recording, read_csv, write_csv, write_table
from daq.recording.shared_rows import overlaps, overlaps_of, row_keys

RATE = 1000.0


def recorded(seed: int, *, joints: int = 2, seconds: float = 6.0, step: float = 1e-4, noise: float = 1.0) -> tuple:
    """t (n,), q (n, J), i (n, J) of one motion that begins and ends at rest; noise of so many steps of the current."""
    generator, t = np.random.default_rng(seed), np.arange(round(seconds * RATE)) / RATE
    phase = np.pi * np.clip((t - 0.5) / (seconds - 1.0), 0.0, 1.0)
    speed = 1.0 + 0.3 * np.arange(joints)
    q = np.sin(phase[:, None]) ** 2 * np.sin(3.0 * speed * phase[:, None])
    i = 2.0 * np.gradient(q, 1 / RATE, axis=0) + 0.5 * np.sin(q)
    q = q + noise * step / 10.0 * generator.standard_normal(q.shape)
    i = i + noise * 0.01 * generator.standard_normal(i.shape)
    return t, np.rint(q / step) * step, np.rint(i / 0.01) * 0.01


def written(path: Path, t: np.ndarray, q: np.ndarray, i: np.ndarray, rows: slice = slice(None)) -> Recording:
    write_table(path, t[rows] - t[rows][0], {"q": q[rows], "i": i[rows]}, Attachments())
    return open_recording(path)


@settings(max_examples=40)
@given(
    joints=st.integers(1, 6),
    step=st.sampled_from([1e-2, 1e-3, 1e-4, 1e-5]),
    noise=st.sampled_from([0.05, 0.3, 1.0, 3.0]),
    seed=st.integers(0, 2**20),
)
def test_a_motion_recorded_twice_is_no_copy(joints: int, step: float, noise: float, seed: int) -> None:
    """With steps that are far larger than the noise, too, where most rows of one recording are in the other."""
    keys = [row_keys(*recorded(seed + k, joints=joints, step=step, noise=noise)[1:]) for k in range(2)]
    assert overlaps_of(keys) == []


@pytest.mark.parametrize(
    "rows", [slice(None), slice(3001, None), slice(2000, 4000), slice(1, None, 2), slice(3, 5000, 7)], ids=str
)
def test_parts_are_known_with_other_times(tmp_path: Path, rows: slice) -> None:
    whole = written(tmp_path / "whole.mcap", *recorded(1))
    part = written(tmp_path / "part.mcap", *recorded(1), rows)
    other = written(tmp_path / "other.mcap", *recorded(2))
    (found,) = overlaps([whole, other, part])
    assert (found.one, found.other) == (0, 2)
    assert found.share == 1.0
    (found,) = overlaps([part, whole])
    assert found.share < 1.0 or rows == slice(None)


def test_a_part_within_another_recording_is_known(tmp_path: Path) -> None:
    (t, q, i), (_, other_q, other_i) = recorded(1), recorded(2)
    mixed = np.concatenate([other_q[:4000], q[4000:]]), np.concatenate([other_i[:4000], i[4000:]])
    pair = [written(tmp_path / "a.mcap", t, q, i), written(tmp_path / "b.mcap", t, *mixed)]
    assert len(overlaps(pair)) == 1


def test_a_table_that_was_exported_and_cut_is_known(tmp_path: Path) -> None:
    whole = written(tmp_path / "whole.mcap", *recorded(1, noise=0.7))
    write_csv(tmp_path / "whole.csv", whole)
    lines = (tmp_path / "whole.csv").read_text().splitlines(keepends=True)
    (tmp_path / "tail.csv").write_text("".join([lines[0], *lines[2501:]]))
    table = read_csv(tmp_path / "tail.csv")
    write_table(tmp_path / "tail.mcap", table.t, table.signals, Attachments())
    (found,) = overlaps([whole, open_recording(tmp_path / "tail.mcap")])
    assert found.share == 1.0


def test_means_of_rows_are_compared_as_they_were_recorded(tmp_path: Path) -> None:
    """Of a part that begins at an odd row, means of two rows are others."""
    written(tmp_path / "whole.mcap", *recorded(1))
    written(tmp_path / "part.mcap", *recorded(1), slice(2001, None))
    pair = [open_recording(tmp_path / f"{name}.mcap", most_numbers=5000) for name in ("whole", "part")]
    assert [one.averaged for one in pair] == [4, 2]
    assert len(overlaps(pair)) == 1
    # what was cut from an object shares no more than it holds
    halves = [
        replace(pair[0], **{name: getattr(pair[0], name)[rows] for name in ("t", "number", "q", "i")})
        for rows in (slice(700), slice(700, None))
    ]
    assert overlaps(halves) == []


def test_of_very_many_rows_the_same_ones_are_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.recording.shared_rows.overlap.MOST", 3000)
    whole = written(tmp_path / "whole.mcap", *recorded(1))
    part = written(tmp_path / "part.mcap", *recorded(1), slice(1501, None))
    assert len(overlaps([whole, part])) == 1
    assert overlaps([whole, written(tmp_path / "other.mcap", *recorded(2))]) == []


def test_a_row_is_known_by_all_its_values() -> None:
    rows = np.random.default_rng(0).standard_normal((1000, 6))
    rows[:10, 2] = np.nan
    keys = row_keys(rows[:, :3], rows[:, 3:])
    assert len(np.unique(keys)) == 1000
    assert np.array_equal(keys, row_keys(rows + 1e-12))
    swapped = rows[:, [1, 0, 2, 3, 4, 5]]
    assert not np.isin(row_keys(swapped), keys).any()
