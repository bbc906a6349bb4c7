"""Real processes that are killed while they record, or meet a limit of the file system."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from daq.acquisition.ledger import LossReason
from daq.recording import open_recording
from daq.recording.recover import recover
from tests.daq.recorded import COLUMNS, make_rows

# Records blocks of 10 rows, and says after each how many rows have been handed over. Goes on until it is killed.
WRITER = """
import sys, time
from daq.recording.recorder import Recorder
from daq.recording.parts import Attachments
from tests.daq.recorded import LAYOUT, make_rows
recorder = Recorder(sys.argv[1], LAYOUT, Attachments(), chunk_seconds=0.02)
for block in range(10**9):
    recorder.append(make_rows(10 * block, 10))
    print(10 * block + 10, flush=True)
    time.sleep(0.001)
"""

# Fills its file up to the limit. Chunks do not fit then; the short end of the file may.
FULL = """
import resource, sys
from daq.recording.recorder import Recorder
from daq.recording.parts import Attachments
from arm_io import DeviceFault
from tests.daq.recorded import LAYOUT, make_rows
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
recorder = Recorder(sys.argv[1], LAYOUT, Attachments(), chunk_seconds=0.0, live=False, queue_rows=100)
for first in range(0, 4000, 50):
    recorder.append(make_rows(first, 50))
try:
    recorder.finish()
except DeviceFault as fault:
    sys.exit(3)
"""


def start(script: str, *arguments: str, root: Path) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", script, *arguments], cwd=root, stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize("seed", range(3))
def test_a_killed_recording_tells_what_is_missing(tmp_path: Path, root: Path, seed: int) -> None:
    path = tmp_path / "run.mcap"
    active = tmp_path / "run.mcap.active"
    process = start(WRITER, str(path), root=root)
    wanted = random.Random(seed).randrange(100, 1500)
    appended = 0
    while appended < wanted:
        appended = int(process.stdout.readline())
    with pytest.raises(InputError, match="being recorded right now"):
        recover(active, path)
    process.send_signal(signal.SIGKILL)
    for line in process.stdout:  # what it had said before the signal came
        appended = int(line) if line.endswith("\n") else appended
    assert process.wait() == -signal.SIGKILL

    as_it_is = open_recording(active)
    assert not as_it_is.finished and as_it_is.notes
    result = recover(active, path)
    recording = open_recording(path)
    rows = make_rows(0, len(recording))
    for name, field in COLUMNS.items():
        np.testing.assert_array_equal(getattr(recording, name), getattr(rows, field), err_msg=name)
    # Every row whose append returned is accounted for, though the ledger was never written.
    assert result.sure and appended <= result.ledger.triggers <= appended + 10 and result.ledger.balanced
    assert result.ledger.recorded == len(recording)
    assert {loss.reason for loss in result.ledger.losses} <= {LossReason.UNFINISHED}
    assert active.exists(), "the source is kept"


@pytest.mark.parametrize("limit", [700, 200_000, 1_000_000])
def test_a_full_disk_leaves_what_is_there_readable(tmp_path: Path, root: Path, limit: int) -> None:
    path = tmp_path / "run.mcap"
    process = start(FULL, str(path), str(limit), root=root)
    process.communicate(timeout=60)
    if limit < 10_000:  # not even the head fits
        assert process.returncode == 1 and not list(tmp_path.iterdir())
        return
    assert process.returncode in (0, 3)
    finished = process.returncode == 0
    recording = open_recording(path if finished else path.with_name("run.mcap.active"))
    assert 0 < len(recording) < 4000 and recording.finished == finished and recording.path.stat().st_size <= limit
    assert recording.ledger.balanced and recording.ledger.triggers == 4000
    # If not even the ledger fitted, only the numbers tell that rows are missing.
    reasons = {LossReason.DISK} if finished else {LossReason.DISK, LossReason.UNKNOWN, LossReason.UNFINISHED}
    assert {loss.reason for loss in recording.ledger.losses} <= reasons
    rows = make_rows(0, 4000)
    for name, field in COLUMNS.items():
        np.testing.assert_array_equal(getattr(recording, name), getattr(rows, field)[recording.number], err_msg=name)
