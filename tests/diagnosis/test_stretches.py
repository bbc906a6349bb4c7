"""Long recordings examined by stretches: which rows, with what clocks, and what the memory of a long one is."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from armscope.api.diagnosis import fit_and_held_out
from daq.recording import Recording, open_recording, open_recordings
from daq.recording.parts import Attachments
from daq.recording.several import extent_of
from daq.recording.tables.table import write_table
from diagnosis.screening.stretches import LENGTH, MOST, NEAR, duration, examined, stretches


def recorded(path: Path, seconds: float, rate: float = 100.0, joints: int = 2) -> Recording:
    """Joints that turn back and forth, and rest every 4 s."""
    t = np.arange(int(seconds * rate)) / rate
    q = np.stack([np.sin(np.pi * t / 4 + joint) ** 3 for joint in range(joints)], axis=1)
    write_table(path, t, {"q": q, "i": np.cos(q)}, Attachments())
    return open_recording(path)


def test_recordings_that_are_short_enough_stay_as_they_are(tmp_path: Path) -> None:
    run, other = recorded(tmp_path / "a.mcap", 40), recorded(tmp_path / "b.mcap", 20)
    fit, held_out, remark = examined([run], [other], most=2 * 60.0)
    assert fit[0] is run and held_out[0] is other and remark is None


def test_stretches_are_spread_over_the_recording_and_begin_where_it_stands(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run.mcap", 1200, joints=1)
    parts = stretches(run, 0.1)
    assert len(parts) == round(120 / LENGTH) and sum(map(duration, parts)) == pytest.approx(120, abs=1.0)
    starts = [(part.wall_ns[0] - run.wall_ns[0]) * 1e-9 for part in parts]
    assert starts[0] == 0.0 and np.allclose(starts, np.linspace(0, 1170, 4), atol=NEAR)
    for part, start in zip(parts, starts):
        row = round(start / run.dt)
        assert part.t[0] == 0.0 and np.array_equal(part.q, run.q[row : row + len(part)])
        assert abs(part.q[1] - part.q[0]) < 1e-3, "it stands, or turns round"
        assert not np.shares_memory(part.q, run.q), "or the whole of it could not be freed"


def test_many_short_recordings_keep_some_seconds_each(tmp_path: Path) -> None:
    runs = [recorded(tmp_path / f"{k}.mcap", 12) for k in range(3)]
    fit, _, remark = examined(runs, [], most=2 * 6.0)
    assert [duration(one) for one in fit] == pytest.approx([10.0] * 3, abs=0.1)
    assert remark is not None and "over 36 s of recordings" in remark


def test_a_long_recording_is_split_and_said_to_be_examined_in_part(tmp_path: Path) -> None:
    recorded(tmp_path / "run.mcap", MOST, rate=25)
    fit, held_out, remarks = fit_and_held_out(tmp_path / "run.mcap", ())
    assert sum(map(duration, [*fit, *held_out])) == pytest.approx(MOST / 2, abs=3.0)
    assert max(one.wall_ns[-1] for one in fit) < min(one.wall_ns[0] for one in held_out)
    assert any("were examined" in remark for remark in remarks)


def test_fast_recordings_are_averaged_to_the_rate_that_suffices(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run.mcap", 4, rate=20_000)
    extent = extent_of(run.path)
    assert (extent.rows, extent.joints) == (80_000, 2) and extent.seconds == pytest.approx(4.0, abs=1e-3)
    ((thinned,),) = open_recordings([run.path], rate=1000.0)
    assert thinned.averaged == 16 and 1 / thinned.dt == pytest.approx(1250)
    ((whole,),) = open_recordings([run.path])
    assert whole.averaged == 1 and np.array_equal(whole.q, run.q)


@pytest.mark.parametrize("rows", [4001, 4002, 4003, 4004])
@pytest.mark.parametrize(("rate", "kept"), [(2000.0, 2000.0), (2500.0, 1250.0), (4000.0, 2000.0), (20_000.0, 1250.0)])
def test_as_few_rows_are_averaged_as_the_rate_asks(rows: int, rate: float, kept: float, tmp_path: Path) -> None:
    run = recorded(tmp_path / "run.mcap", (rows + 0.5) / rate, rate=rate)
    assert len(run) == rows
    ((thinned,),) = open_recordings([run.path], rate=1000.0)
    assert 1 / thinned.dt == pytest.approx(kept)


def test_memory_of_reading_is_bounded(tmp_path: Path) -> None:
    recorded(tmp_path / "run.mcap", 20, rate=5000)
    numbers, peaks = 8_000, []
    for most in (numbers, None):
        tracemalloc.start()
        open_recording(tmp_path / "run.mcap", most_numbers=most)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[0] < 0.5 * peaks[1]
