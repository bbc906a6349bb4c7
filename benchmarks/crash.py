"""Killed a hundred times: processes that record at 5 kHz get SIGKILL at a random moment; what their files still hold.

Each child stamps its rows with the time at which they were made, in blocks of 10 ms, as the sampler does. Missing is
the time from the last row in the file to the kill.

* killed_recoverable_share: files that recover reads, with every row right (1 wanted)
* killed_told_share: files whose missing rows recover reports, to the row (1 wanted)
* killed_missing_ms_*: median and largest time missing (at most 300 wanted)

Run as ``python -m benchmarks.crash [--json]``.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.report import report
from daq.acquisition.ledger import LossReason
from daq.acquisition.rows import Rows
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder, rows_layout
from daq.recording.recover import recover

TRIALS, AT_ONCE = 100, 2
RATE, BLOCK_SECONDS = 5000, 0.01
LAYOUT = rows_layout(
    [f"joint{k}" for k in range(1, 7)], counters=[f"c{k}" for k in range(6)], inputs=["v1", "v2"], demand=True
)


def make_rows(first: int, count: int, wall_ns: int) -> Rows:
    """Rows whose every value follows from their number, ending at ``wall_ns``."""
    number = np.arange(first, first + count)
    times = wall_ns - (first + count - 1 - number) * (10**9 // RATE)
    value = np.sin(number[:, None] + np.arange(6))
    counts = number[:, None] * 1000 + np.arange(6)
    return Rows(
        number, times, times, number, counts, value[:, :2], np.zeros((count, 8), np.uint8), value, -value, None, value
    )


def record_until_killed(path: Path) -> None:
    """In the child: the real recorder at the real pace."""
    recorder = Recorder(path, LAYOUT, Attachments())
    start, made = time.time_ns(), 0
    while True:
        now = time.time_ns()
        due = int((now - start) * RATE / 1e9)
        if due > made:
            recorder.append(make_rows(made, due - made, now))
            made = due
        time.sleep(BLOCK_SECONDS)


def trial(path: Path, delay: float) -> tuple[int, int]:
    """Starts a child; returns its process id and the time at which to kill it (monotonic ns)."""
    child = os.fork()
    if child == 0:
        try:
            record_until_killed(path)
        finally:
            os._exit(1)
    return child, time.monotonic_ns() + int(delay * 1e9)


def right(recording: Recording) -> bool:
    """Rows 0, 1, 2 ... without a hole, each with its own values."""
    wanted = make_rows(0, len(recording), 0)
    pairs = [(recording.number, wanted.number), (recording.q, wanted.position), (recording.counts, wanted.counts)]
    pairs += [(recording.i, wanted.current), (recording.qref, wanted.demand), (recording.volts, wanted.volts)]
    return all(np.array_equal(have, expected) for have, expected in pairs)


def measure() -> dict[str, float]:
    dice = random.Random()
    missing, rescued, accounted = [], 0, 0
    with tempfile.TemporaryDirectory(prefix="armscope-") as folder:
        for first in range(0, TRIALS, AT_ONCE):
            paths = [Path(folder) / f"run{number}.mcap" for number in range(first, first + AT_ONCE)]
            running = sorted((trial(path, dice.uniform(0.5, 2.0))[::-1], path) for path in paths)
            for (due, child), path in running:
                time.sleep(max(0.0, (due - time.monotonic_ns()) * 1e-9))
                killed = time.time_ns()
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                result = recover(path.with_name(path.name + ".active"), path)
                recording = open_recording(path)
                rescued += right(recording)
                last = int(recording.wall_ns[-1]) if len(recording) else killed - 10**12
                missing.append((killed - last) * 1e-6)
                ledger = result.ledger
                accounted += (
                    result.sure
                    and ledger.triggers == len(recording) + ledger.lost
                    and {loss.reason for loss in ledger.losses} <= {LossReason.UNFINISHED}
                    # rows that the child made in the rest of the time were still its own, at most a few blocks
                    and killed - last - ledger.lost * 10**9 // RATE < 10 * BLOCK_SECONDS * 1e9
                )
            if sys.stderr.isatty():
                print(f"\r{first + AT_ONCE} of {TRIALS}", end="", file=sys.stderr)
    return {
        "killed_trials": float(len(missing)),
        "killed_recoverable_share": rescued / len(missing),
        "killed_told_share": accounted / len(missing),
        "killed_missing_ms_median": float(np.median(missing)),
        "killed_missing_ms_max": float(np.max(missing)),
    }


if __name__ == "__main__":
    report(measure())
