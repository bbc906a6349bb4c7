"""Recordings of any length.

Read block by block they say the same as read whole, and take the same memory whatever their length.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.acquisition.ledger import Loss, LossReason
from daq.recording import Recording, open_long, open_recording, write_csv
from daq.recording.missing_rows import FoundRows, TriggerRuns
from daq.recording.parts import Attachments
from daq.recording.plots import POINTS, Envelope
from daq.recording.recorder import Recorder
from daq.recording.summary import summary
from daq.service.replay import blocks_of
from tests.daq.recorded import COLUMNS, LAYOUT, make_rows
from tests.ports import free_endpoint

RIG = """
name = "bench"
[tracker]
base_from_tracker = [[0.0, -1.0, 0.0, 0.35], [1.0, 0.0, 0.0, -2.40], [0.0, 0.0, 1.0, 0.25], [0.0, 0.0, 0.0, 1.0]]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 20 chunks, in which rows are missing within a chunk and between chunks."""
    path = tmp_path_factory.mktemp("long") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.recorder.CHUNK_BYTES", 30_000)
        with Recorder(path, LAYOUT, Attachments(rig=RIG), live=False) as recorder:
            for first, count in ((0, 333), (340, 500), (841, 159)):
                recorder.append(make_rows(first, count))
            gone = [Loss(333, 7, LossReason.NOT_LATCHED), Loss(840, 1, LossReason.LOST_EDGE)]
            recorder.finish(losses=gone)
    return path


def joined(blocks: list[Recording], name: str) -> np.ndarray:
    return np.concatenate([getattr(block, name) for block in blocks])


def test_blocks_are_the_whole(recorded: Path) -> None:
    whole, long = open_recording(recorded), open_long(recorded)
    blocks = list(long.blocks())
    assert len(blocks) >= 15 and len(long) == len(whole) == 992
    for name in ("t", "xyz", *COLUMNS):
        np.testing.assert_array_equal(joined(blocks, name), getattr(whole, name), err_msg=name)
    assert (long.dt, long.duration, long.ledger, long.notes) == (whole.dt, whole.duration, whole.ledger, whole.notes)
    assert long.rig == whole.rig and long.attachments == whole.attachments


def test_they_are_summed_up_alike(recorded: Path) -> None:
    of_blocks, of_all = summary(open_long(recorded)), summary(open_recording(recorded))
    assert [gap["triggers"] for gap in of_all["gaps"]] == [7, 1]
    for row, other in zip(of_blocks["signals"], of_all["signals"]):
        assert row.pop("rms") == pytest.approx(other.pop("rms"), rel=1e-12)
    assert of_blocks == of_all


def test_exports_and_replays_are_alike(recorded: Path, tmp_path: Path) -> None:
    for name, recording in (("blocks", open_long(recorded)), ("all", open_recording(recorded))):
        write_csv(tmp_path / f"{name}.csv", recording)
    assert (tmp_path / "blocks.csv").read_bytes() == (tmp_path / "all.csv").read_bytes()
    one, other = list(blocks_of(open_long(recorded))), list(blocks_of(open_recording(recorded)))
    assert [due for due, _ in one] == [due for due, _ in other]
    for (_, block), (_, same) in zip(one, other):
        assert block.keys() == same.keys()
        np.testing.assert_array_equal(block["number"], same["number"])


def test_the_period_of_a_very_long_one_is_that_of_rows_spread_over_it(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.recording.blocks.MOST_STEPS", 100)
    assert open_long(recorded).dt == pytest.approx(open_recording(recorded).dt, abs=1e-7)


@given(st.lists(st.tuples(st.lists(st.integers(1, 3), max_size=6), st.booleans()), max_size=8))
def test_numbers_are_kept_as_runs(pieces: list[tuple[list[int], bool]]) -> None:
    """Against a plain list of all numbers."""
    numbers, every, last = TriggerRuns(), [], -1
    for steps, torn in pieces:
        piece = last + np.cumsum(steps, dtype=np.int64)
        numbers.append(piece, torn=torn)
        every += piece.tolist()
        last = every[-1] if every else last
    runs = numbers.runs()
    assert [number for first, stop, _ in runs.tolist() for number in range(first, stop + 1)] == every
    assert (runs[1:, 0] > runs[:-1, 1] + 1).all() and FoundRows(runs, True).rows == len(every)


@settings(max_examples=30)
@given(rows=st.integers(1, 30_000), seed=st.integers(0, 99))
def test_a_thinned_line_has_the_extremes_of_all_rows(rows: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    values, t = random.normal(size=(rows, 2)), np.arange(rows) * 1e-3
    values[random.random((rows, 2)) < 0.1] = np.nan
    envelope = Envelope(rows)
    for start in range(0, rows, 777):
        envelope.add(t[start : start + 777], values[start : start + 777])
    for k, (x, y) in enumerate(envelope.lines()):
        assert len(x) <= max(POINTS * 1.01 + 2, rows if rows <= POINTS else 0) and (np.diff(x) >= 0).all()
        assert np.nanmax(y, initial=-9) == np.nanmax(values[:, k], initial=-9)
        assert np.nanmin(y, initial=9) == np.nanmin(values[:, k], initial=9)


EVERY_COMMAND = """
import sys
from armscope.cli import run
folder, endpoint = sys.argv[1:]
recording, out = f"{folder}/run.mcap", f"{folder}/out"
for arguments in (
    ["info", recording, "--verify"],
    ["export", recording, "--out", f"{out}.csv"],
    ["import", f"{out}.csv", "--out", f"{out}.mcap"],
    ["plot", recording, "--out", f"{out}.png"],
    ["replay", recording, "--speed", "inf", "--wait", "0", "--endpoint", endpoint],
    ["recover", recording, "--out", f"{out}_again.mcap"],
):
    assert run(arguments) == 0, arguments
with open("/proc/self/status") as status:
    (peak,) = [line.split()[1] for line in status if line.startswith("VmHWM")]
print(peak)
"""
"""Prints the largest resident set of the process, kB.

Of it alone, where ``wait4`` counts its parent's before the first instruction in.
"""
ROWS = 15_000
MOST_GROWTH = 20.0
"""MB: the windows of a mapped file, a chunk, a block of text.

Rows kept in memory take 35 MB more already as arrays of one command.
"""


def test_five_times_the_rows_take_no_more_memory(root: Path, tmp_path: Path) -> None:
    peaks = []
    for times in (1, 5):
        folder = tmp_path / str(times)
        folder.mkdir()
        with Recorder(folder / "run.mcap", LAYOUT, Attachments(), live=False) as recorder:
            for first in range(0, times * ROWS, 5000):
                recorder.append(make_rows(first, 5000))
        command = [sys.executable, "-c", EVERY_COMMAND, str(folder), free_endpoint()]
        process = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=120)
        assert process.returncode == 0, process.stderr
        peaks.append(int(process.stdout.split()[-1]) / 1024)
    assert peaks[1] - peaks[0] < MOST_GROWTH, peaks
