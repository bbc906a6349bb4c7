"""A whole rig whose clock is 100 ppm fast, through bytes.

The run's rows keep the host's time, and the recorded fit shows the drift.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.acquisition import Acquisition
from daq.rig.bench import open_bench
from daq.rig.rig_file import read_rig
from drivers.labjack_t7.protocol import CORE_TIMER_HZ
from sim_backend.protocol import labjack_t7 as simulator
from tests.drivers.lab_rig import write_rig
from tests.drivers.swing import swing_wires

PPM = 100.0
SECONDS = 6.0
RATE = 500.0
# ns of uncertainty at the ends of a fit: a machine that keeps every reading waiting says nothing about 100 ppm
BUSY = 25_000


def test_a_t7_whose_crystal_is_fast(tmp_path: Path) -> None:
    for _ in range(5):
        acquisition, rows, started = run(tmp_path)
        fit = acquisition.clocks()[0]
        if max(fit.std_ns) < BUSY:
            break
    else:
        pytest.skip("too busy a machine to read a clock")
    assert acquisition.ledger.summary().lost == 0 and len(rows) == SECONDS * RATE
    seconds = SECONDS - 1 / RATE
    drift = (fit.tick_rate / CORE_TIMER_HZ - 1) * 1e6
    assert drift == pytest.approx(PPM, abs=10 + 6 * max(fit.std_ns) * 1e-3 / seconds)
    true = started + (np.arange(len(rows)) + 1) / (RATE * (1 + PPM * 1e-6)) * 1e9
    off = rows[:, 0] - true
    # By the nominal rate the last row would be 600 us out; the remainder is a reading's round trip.
    assert np.abs(off[-500:]).max() < 300_000
    assert (np.diff(rows[:, 0]) > 0).all()
    fitted = fit.to_host(rows[:, 1]) - true
    assert np.abs(fitted).max() < 300_000


def run(tmp_path: Path) -> tuple[Acquisition, np.ndarray, int]:
    """The acquisition, its rows' host times and ticks (n, 2), and the ns at which the T7's stream began."""
    path, where = write_rig(tmp_path)
    box = simulator.make("daq", where, swing_wires())
    box.clock_ppm = PPM
    box.open()
    try:
        with open_bench(read_rig(path)) as bench:
            acquisition = Acquisition(bench, seconds=SECONDS)
            acquisition.arm()
            acquisition.start()
            rows = np.concatenate([np.column_stack([r.host_ns, r.tick]) for r in acquisition.rows()])
            return acquisition, rows, box._started
    finally:
        box.close()
