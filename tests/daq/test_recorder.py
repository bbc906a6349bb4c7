"""Rows that go into the recorder come back from the reader, to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.ledger import Loss, LossReason
from daq.recorder import Recorder, rows_layout
from daq.recording import open_recording
from daq.recording_file import Attachments
from daq.rows import Rows
from daq.table import write_table
from inputs import InputError

JOINTS, COUNTERS, INPUTS = 3, 2, 4
LAYOUT = rows_layout(
    [f"joint{j}" for j in range(1, JOINTS + 1)],
    counters=["c1", "c2"],
    inputs=["v1", "v2", "v3", "v4"],
    tracker=True,
    demand=True,
    effort=[1.0, 2.0, 3.0],
)


def make_rows(first: int, count: int, seed: int = 0) -> Rows:
    """``count`` rows of random values at 1 kHz with trigger numbers from ``first``."""
    random = np.random.default_rng([seed, first])
    number = np.arange(first, first + count)
    return Rows(
        number=number,
        host_ns=5 * 10**12 + number * 1_000_000,
        wall_ns=1_700_000_000 * 10**9 + number * 1_000_000 + random.integers(0, 1000, count),
        tick=number * 7,
        counts=random.integers(-(2**62), 2**62, (count, COUNTERS)),
        volts=random.normal(size=(count, INPUTS)),
        quality=random.integers(0, 64, (count, COUNTERS + INPUTS + 1)).astype(np.uint8),
        position=random.normal(size=(count, JOINTS)),
        current=np.where(random.random((count, JOINTS)) < 0.1, np.nan, random.normal(size=(count, JOINTS))),
        points=random.normal(size=(count, 3)),
        demand=random.normal(size=(count, JOINTS)),
    )


def join(blocks: list[Rows], name: str) -> np.ndarray:
    return np.concatenate([getattr(block, name) for block in blocks])


def test_rows_come_back_to_the_last_bit(tmp_path: Path) -> None:
    blocks = [make_rows(0, 1), make_rows(1, 10), make_rows(11, 700), make_rows(711, 3)]
    with Recorder(
        tmp_path / "run.mcap", LAYOUT, Attachments(rig='name = "bench"', calibration={"hash": "x"})
    ) as recorder:
        for block in blocks:
            recorder.append(block)
        ledger = recorder.finish()
    assert ledger.balanced and ledger.recorded == 714 and not ledger.losses
    recording = open_recording(tmp_path / "run.mcap")
    names = {"q": "position", "i": "current", "qref": "demand", "points": "points"}
    for name in ("number", "wall_ns", "host_ns", "tick", "counts", "volts", "quality", *names):
        np.testing.assert_array_equal(getattr(recording, name), join(blocks, names.get(name, name)), err_msg=name)
    assert recording.rig == {"name": "bench"} and recording.calibration == {"hash": "x"}
    assert recording.ledger == ledger and recording.finished and not recording.notes and not recording.gaps
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_losses_before_latching_stand_in_the_ledger(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", LAYOUT, Attachments()) as recorder:
        recorder.append(make_rows(0, 10))
        recorder.append(make_rows(13, 10))
        recorder.finish(triggers=23, losses=[Loss(10, 3, LossReason.LOST_EDGE)])
    recording = open_recording(tmp_path / "run.mcap")
    assert recording.ledger.balanced and recording.ledger.lost == 3
    assert [(gap.row, gap.triggers) for gap in recording.gaps] == [(9, 3)]


def test_no_recording_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        Recorder(tmp_path / "run.mcap", LAYOUT, Attachments())
    (tmp_path / "other.mcap.active").write_text("precious too")
    with pytest.raises(InputError, match="unfinished recording"):
        Recorder(tmp_path / "other.mcap", LAYOUT, Attachments())


def test_a_table_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    t = np.cumsum(random.uniform(0.0007, 0.0088, 5000)) - 3.0
    q, i, ql = random.normal(size=(5000, 2)), random.normal(size=(5000, 2)), random.normal(size=(5000, 2))
    ql[:, 0] = np.nan
    i[17, 1] = np.nan
    write_table(tmp_path / "t.mcap", t, {"q": q, "i": i, "ql": ql}, Attachments(), extra={"room": t * 2})
    recording = open_recording(tmp_path / "t.mcap")
    for name, values in {"time": t, "t": t - t[0], "q": q, "i": i, "ql": ql}.items():
        np.testing.assert_array_equal(getattr(recording, name), values, err_msg=name)
    np.testing.assert_array_equal(recording.extra["room"], t * 2)
    assert recording.counts is None and recording.qref is None and recording.layout.signals["ql"] == (2,)
