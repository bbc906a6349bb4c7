"""A cable pulled and put back in the middle of a run: the run goes on, and the gap stands in the ledger."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.ledger import LossReason
from daq.acquisition.states import End
from daq.rig.bench import open_bench
from daq.rig.rig_file import read_rig
from sim_backend.protocol import labjack_t7 as simulator
from tests.drivers.lab_rig import write_rig
from tests.drivers.swing import counts, swing_wires


def run(tmp_path: Path, *, away: float, patience: float, seconds: float) -> tuple[Acquisition, np.ndarray, np.ndarray]:
    path, where = write_rig(tmp_path, patience)
    box = simulator.make("daq", where, swing_wires())
    box.open()

    def pull() -> None:
        box.pull_cable()
        time.sleep(away)
        box.plug_cable()

    with open_bench(read_rig(path)) as bench:
        acquisition = Acquisition(bench, seconds=seconds)
        acquisition.arm()
        acquisition.start()
        threading.Timer(0.4, pull).start()
        blocks = list(acquisition.rows())
        time.sleep(max(0.0, away - 0.5))
    box.close()
    number = np.concatenate([rows.number for rows in blocks])
    zero = np.array([box._zero[line] for line in (0, 2)])
    rows = np.concatenate([np.column_stack([r.host_ns, r.counts + zero]) for r in blocks])
    return acquisition, number, rows


def test_the_gap_is_in_the_ledger_and_nothing_is_shifted(tmp_path: Path) -> None:
    acquisition, number, rows = run(tmp_path, away=0.8, patience=3.0, seconds=2.5)
    assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE
    summary = acquisition.ledger.summary()
    assert summary.triggers == 1250 == summary.latched + summary.lost
    assert 400 <= summary.lost < 900  # 0.8 s away, and at most as long again until the next try
    assert {loss.reason for loss in summary.losses} <= {
        LossReason.NOT_LATCHED,
        LossReason.DEVICE_GONE,
        LossReason.LOST_EDGE,
    }
    assert np.all(np.diff(number) >= 1) and number[-1] == 1249
    host = rows[:, 0]
    # Numbers and times go together over the gap; the T7's own timer, started anew, is up to half a period off the old
    # grid.
    assert np.abs(np.diff(host) / 2e6 - np.diff(number)).max() < 0.55
    for c in (0, 1):
        assert np.abs(rows[:, 1 + c] - counts(c, host)).max() < 200


def test_a_cable_that_stays_out_ends_the_run_with_what_there_was(tmp_path: Path) -> None:
    acquisition, number, _ = run(tmp_path, away=1.5, patience=0.6, seconds=5.0)
    assert acquisition.ending is not None and acquisition.ending.reason is End.DEVICE_LOST
    assert len(number) > 100 and acquisition.ledger.summary().triggers >= len(number)
