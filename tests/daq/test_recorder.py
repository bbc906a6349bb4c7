"""Rows that go into the recorder come back from the reader, to the last bit; what does not is in the ledger."""

from __future__ import annotations

import dataclasses
import io
import os
import threading
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import DeviceFault, InputError
from daq.acquisition.ledger import Loss, LossReason
from daq.recording import open_recording, warnings_on
from daq.recording.mcap_file.writer import McapFile, create
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder, rows_layout
from daq.recording.tables.table import write_table
from tests.daq.recorded import COLUMNS, LAYOUT, join, make_rows


def test_rows_come_back_to_the_last_bit(tmp_path: Path) -> None:
    blocks = [make_rows(0, 1), make_rows(1, 10), make_rows(11, 5000), make_rows(5011, 3)]
    with Recorder(
        tmp_path / "run.mcap", LAYOUT, Attachments(rig='name = "bench"', calibration={"hash": "x"})
    ) as recorder:
        for block in blocks:
            recorder.append(block)
        ledger = recorder.finish()
    assert ledger.balanced and ledger.recorded == 5014 and not ledger.losses
    assert recorder.finish() is ledger
    recording = armscope.open(tmp_path / "run.mcap")
    for name, field in COLUMNS.items():
        np.testing.assert_array_equal(getattr(recording, name), join(blocks, field), err_msg=name)
    np.testing.assert_allclose(recording.t, (recording.wall_ns - recording.wall_ns[0]) / 1e9)
    assert repr(recording) == f"<Recording run.mcap: 5014 rows of 3 joints, {recording.t[-1]:.3f} s>"
    assert recording.rig == {"name": "bench"} and recording.calibration == {"hash": "x"}
    assert recording.ledger == ledger and recording.finished and not recording.notes and not recording.gaps
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_points_come_in_the_base_frame_where_the_rig_tells_it(tmp_path: Path) -> None:
    rig = '[tracker]\nbase_from_tracker = [[0,-1,0,1],[1,0,0,2],[0,0,1,3],[0,0,0,1]]\n[[joint]]\nname="a"\n'
    with Recorder(tmp_path / "run.mcap", LAYOUT, Attachments(rig=rig)) as recorder:
        recorder.append(make_rows(0, 5))
    recording = open_recording(tmp_path / "run.mcap")
    x, y, z = recording.points.T
    np.testing.assert_allclose(recording.xyz, np.column_stack([1 - y, 2 + x, 3 + z]))


def test_an_empty_recording_is_one(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", LAYOUT, Attachments()):
        pass
    recording = open_recording(tmp_path / "run.mcap")
    assert len(recording) == 0 and recording.q.shape == (0, 3) and recording.counts.dtype == np.int64
    assert np.isnan(recording.dt) and recording.ledger.balanced


def test_a_rig_without_tracker_and_demand(tmp_path: Path) -> None:
    layout = rows_layout(["joint1", "joint2", "joint3"], counters=["c1", "c2"], inputs=["v1", "v2", "v3", "v4"])
    rows = make_rows(0, 20)
    rows = dataclasses.replace(rows, qref=None, points=None, quality=rows.quality[:, :6])
    with Recorder(tmp_path / "run.mcap", layout, Attachments()) as recorder:
        recorder.append(rows)
    recording = open_recording(tmp_path / "run.mcap")
    assert recording.qref is None and recording.points is None and recording.xyz is None
    np.testing.assert_array_equal(recording.quality, rows.quality)


def test_demands_and_points_may_come_and_go(tmp_path: Path) -> None:
    """Rows without demands or points where the layout has them are NaN there.

    The other way round is a bug, and reported.
    """
    first, second = make_rows(0, 10), dataclasses.replace(make_rows(10, 10), qref=None, points=None)
    with Recorder(tmp_path / "run.mcap", LAYOUT, Attachments()) as recorder:
        recorder.append(first)
        recorder.append(second)
    recording = open_recording(tmp_path / "run.mcap")
    assert np.isnan(recording.qref[10:]).all() and np.isnan(recording.points[10:]).all()
    np.testing.assert_array_equal(recording.qref[:10], first.qref)
    narrow = rows_layout(["joint1", "joint2", "joint3"], counters=["c1", "c2"], inputs=["v1", "v2", "v3", "v4"])
    recorder = Recorder(tmp_path / "other.mcap", narrow, Attachments())
    recorder.append(first)
    with pytest.raises(ValueError, match="rows have demand|rows have points"):
        recorder.finish()


def test_losses_before_latching_stand_in_the_ledger(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", LAYOUT, Attachments()) as recorder:
        recorder.append(make_rows(0, 10))
        recorder.append(make_rows(13, 10))
        recorder.finish(triggers=23, losses=[Loss(10, 3, LossReason.LOST_EDGE)])
    recording = open_recording(tmp_path / "run.mcap")
    assert recording.ledger.balanced and recording.ledger.lost == 3
    assert [(gap.row, gap.triggers) for gap in recording.gaps] == [(9, 3)]


def test_whoever_reads_a_run_that_a_fault_ended_is_warned(tmp_path: Path) -> None:
    """Its rows are whole; but they are fewer than the experiment has, and ``identify`` took them without a word."""
    warnings = {}
    for fault in (True, False):
        with Recorder(path := tmp_path / f"{fault}.mcap", LAYOUT, Attachments()) as recorder:
            recorder.append(make_rows(0, 10))
            recorder.finish(closing={"ending": {"reason": "?", "sentence": "the card is gone", "fault": fault}})
        with warnings_on(stream := io.StringIO()) as incomplete:
            open_recording(path)
        warnings[fault] = stream.getvalue()
        assert not incomplete
    assert warnings[True] == f"warning: {tmp_path}/True.mcap: the run was ended by a fault: the card is gone\n"
    assert not warnings[False]


def test_what_the_queue_cannot_take_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk_is_back, stuck = threading.Event(), threading.Event()
    sync = McapFile.sync

    def hanging(self: McapFile) -> None:
        stuck.set()
        assert disk_is_back.wait(30)
        sync(self)

    monkeypatch.setattr(McapFile, "sync", hanging)
    recorder = Recorder(tmp_path / "run.mcap", LAYOUT, Attachments(), chunk_seconds=0.0, queue_rows=100)
    recorder.append(make_rows(0, 50))
    assert stuck.wait(30)  # the writer has them, and waits for the disk
    recorder.append(make_rows(50, 60))
    for first in (110, 160):
        recorder.append(make_rows(first, 50))
    disk_is_back.set()
    ledger = recorder.finish()
    assert ledger.balanced and ledger.recorded == 110
    assert [(loss.first, loss.rows, loss.reason) for loss in ledger.losses] == [(110, 100, LossReason.QUEUE_FULL)]
    assert open_recording(tmp_path / "run.mcap").ledger == ledger


def test_a_simulation_waits_instead(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", LAYOUT, Attachments(), live=False, queue_rows=100)
    for first in range(0, 5000, 50):
        recorder.append(make_rows(first, 50))
    ledger = recorder.finish()
    assert ledger.recorded == 5000 and not ledger.losses


def test_a_full_disk_costs_only_what_did_not_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk takes part of one chunk, then nothing, then has room again: the part is undone, the rows are counted."""
    written = threading.Semaphore(0)
    room = [10**9]
    pwrite = os.pwrite

    def limited(handle: int, data: bytes, place: int) -> int:
        if place < 10_000:  # the head and the progress have their blocks already
            return pwrite(handle, data, place)
        if room[0] <= 0:
            raise OSError(28, "No space left on device")
        count = pwrite(handle, data[: room[0]], place)
        room[0] -= count
        return count

    sync = McapFile.sync
    monkeypatch.setattr(McapFile, "sync", lambda self: (sync(self), written.release())[0])
    monkeypatch.setattr("daq.recording.mcap_file.writer.os.pwrite", limited)
    recorder = Recorder(tmp_path / "run.mcap", LAYOUT, Attachments(), chunk_seconds=0.0)
    for first, space in ((0, 10**9), (100, 3000), (200, 0), (300, 10**9)):
        room[0] = space
        recorder.append(make_rows(first, 100))
        assert written.acquire(timeout=30)
    ledger = recorder.finish()
    assert [(loss.first, loss.rows, loss.reason) for loss in ledger.losses] == [(100, 200, LossReason.DISK)]
    recording = open_recording(tmp_path / "run.mcap")
    np.testing.assert_array_equal(recording.number, [*range(100), *range(300, 400)])
    assert recording.ledger == ledger and ledger.balanced


def test_a_disk_that_stays_full_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(tmp_path / "run.mcap", LAYOUT, Attachments(), chunk_seconds=0.0)
    recorder.append(make_rows(0, 100))
    while not recorder.recorded:
        threading.Event().wait(0.001)

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("daq.recording.mcap_file.writer.os.pwrite", full)
    recorder.append(make_rows(100, 100))
    with pytest.raises(DeviceFault, match=r"No space left.*100 rows are safe.*100 are lost"):
        recorder.finish()
    monkeypatch.undo()
    recording = open_recording(tmp_path / "run.mcap.active")
    assert len(recording) == 100 and not recording.finished


def test_no_recording_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        Recorder(tmp_path / "run.mcap", LAYOUT, Attachments())
    (tmp_path / "other.mcap.active").write_text("precious too")
    with pytest.raises(InputError, match="unfinished recording"):
        Recorder(tmp_path / "other.mcap", LAYOUT, Attachments())
    with pytest.raises(InputError, match="there is no folder"):
        Recorder(tmp_path / "nowhere" / "other.mcap", LAYOUT, Attachments())


def test_two_processes_do_not_write_the_same_file(tmp_path: Path) -> None:
    first = create(tmp_path / "run.mcap", replace=True)
    first.attach("notes.txt", "text/plain", b"mine")
    with pytest.raises(InputError, match="being written by another process"):
        create(tmp_path / "run.mcap", replace=True)
    assert b"mine" in first.active.read_bytes()
    first.abandon()
    assert not list(tmp_path.iterdir())


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
    assert not recording.gaps, "jitter is no gap"
    assert recording.counts is None and recording.qref is None and recording.layout.signals["ql"] == (2,)


def test_a_pause_in_a_table_is_a_gap(tmp_path: Path) -> None:
    t = np.arange(100) * 0.01
    t[40:] += 0.5
    q = np.zeros((100, 1))
    write_table(tmp_path / "t.mcap", t, {"q": q, "i": q}, Attachments())
    (gap,) = open_recording(tmp_path / "t.mcap").gaps
    assert (gap.row, gap.triggers) == (39, 0) and gap.seconds == pytest.approx(0.51)
