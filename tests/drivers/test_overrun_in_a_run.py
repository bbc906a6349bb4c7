"""A T7 that skips scans in a run.

The numbers stay true even where its count of them means something else than the documents say.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.ledger import LossReason
from daq.rig.bench import open_bench
from daq.rig.rig_file import read_rig
from drivers.labjack_t7 import protocol as t7
from sim_backend.protocol import labjack_t7 as simulator
from tests.drivers.lab_rig import write_rig
from tests.drivers.swing import swing_wires

RATE = 2000.0


@pytest.mark.parametrize("otherwise", [0, 1, -1])
def test_skipped_scans_are_counted_by_the_t7_and_checked_by_its_timer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, otherwise: int
) -> None:
    """``otherwise``: whether the scan that marks the hole counts as skipped is not confirmed on a real device."""
    resume = simulator.Buffer._resume

    def counted_otherwise(buffer: simulator.Buffer) -> None:
        resume(buffer)
        buffer.info += otherwise

    monkeypatch.setattr(simulator.Buffer, "_resume", counted_otherwise)
    path, where = write_rig(tmp_path)
    path.write_text(path.read_text().replace("rate = 500.0", f"rate = {RATE}"))
    box = simulator.make("daq", where, swing_wires())
    box.open()

    def stall() -> None:
        """The network takes nothing for a while."""
        with box._lock:
            box._buffer.capacity = 400
            connection, box._stream.connection = box._stream.connection, None
        time.sleep(0.3)
        with box._lock:
            box._stream.connection = connection

    with open_bench(read_rig(path)) as bench:
        acquisition = Acquisition(bench, seconds=2.0)
        acquisition.arm()
        acquisition.start()
        threading.Timer(0.5, stall).start()
        blocks = list(acquisition.rows())
    box.close()
    number, tick = (np.concatenate([getattr(rows, name) for rows in blocks]) for name in ("number", "tick"))
    summary = acquisition.ledger.summary()
    assert summary.triggers == len(number) + summary.lost and summary.lost > 100
    assert {loss.reason for loss in summary.losses} <= {LossReason.NOT_LATCHED, LossReason.LOST_EDGE}
    periods = np.diff(tick) / t7.CORE_TIMER_HZ * RATE
    assert np.abs(periods - np.diff(number)).max() < 0.1
