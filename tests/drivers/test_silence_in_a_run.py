"""A device that says nothing for a second: the run's end names it, and the gap is not taken for speed."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.states import End
from daq.rig.bench import open_bench
from daq.rig.rig_file import Rig, read_rig
from drivers.cia406 import device as cia406
from sim_backend.protocol import cia406 as sim_cia406
from sim_backend.protocol import labjack_t7 as sim_t7
from tests.drivers.lab_rig import write_rig
from tests.drivers.swing import AMPLITUDE, swing_wires


def test_a_t7_that_is_silent_is_named(tmp_path: Path) -> None:
    path, where = write_rig(tmp_path)
    path.write_text(
        path.read_text().replace("watchdog = 4.0", "watchdog = 0.4").replace("timeout = 0.3", "timeout = 1.5")
    )
    box = sim_t7.make("daq", where, swing_wires())
    box.open()

    def fall_silent() -> None:
        with box._lock:
            time.sleep(1.0)

    with open_bench(read_rig(path)) as bench:
        acquisition = Acquisition(bench, seconds=6.0)
        acquisition.arm()
        acquisition.start()
        threading.Timer(0.5, fall_silent).start()
        rows = sum(len(block) for block in acquisition.rows())
    box.close()
    assert rows > 0
    assert acquisition.ending is not None
    assert acquisition.ending.reason is End.NO_ANSWER
    assert str(acquisition.ending).endswith("(daq did not answer for 0.4 s)")
    assert acquisition.ledger.imbalance() is None


FASTEST = AMPLITUDE * 2 * np.pi * 2 / 4
"""Counts/s of channel 1."""


def can_rig(where: cia406.Config) -> Rig:
    """Two encoders on CAN, 100 rows/s by SYNC; joint 2 goes at most 1 rad/s, and 1.3 rad/s are allowed."""
    options = where.model_dump(mode="json", exclude_unset=True)
    scale = {"counts_per_radian": FASTEST, "offset": -float(1 << 24) / FASTEST}
    return Rig.model_validate(
        {
            "name": "can",
            "watchdog": 5.0,
            "trigger": {"source": "poll", "device": "encoders", "rate": 100.0},
            "device": [{"name": "encoders", "driver": "drivers.cia406", **options}],
            "joint": [{"encoder": {"device": "encoders", "channel": channel, **scale}} for channel in range(2)],
            "limits": {"speed": [1.3, 1.3]},
        }
    )


def late(box: Any) -> None:
    """What joint 2 answers comes a second late."""
    box.encoders[2].delay = 1.0
    time.sleep(1.0)
    box.encoders[2].delay = 0.0


def mute(box: Any) -> None:
    """Nobody answers for a second."""
    for encoder in box.encoders.values():
        encoder.mute = True
    time.sleep(1.0)
    for encoder in box.encoders.values():
        encoder.mute = False


@pytest.mark.parametrize("stall", [late, mute])
def test_a_gap_is_no_speed(stall: Callable[[Any], None]) -> None:
    where = cia406.Config(
        nodes=(1, 2), bits=25, timeout=0.02, patience=3.0, latest=0.4, interface="virtual", channel=uuid.uuid4().hex
    )
    box = sim_cia406.make("box", where, swing_wires())
    box.open()
    with open_bench(can_rig(where)) as bench:
        acquisition = Acquisition(bench, seconds=3.0)
        acquisition.arm()
        acquisition.start()
        threading.Timer(0.7, stall, (box,)).start()
        blocks = list(acquisition.rows())
    box.close()
    assert acquisition.ending is not None
    assert acquisition.ending.reason is End.ROWS_DONE, acquisition.ending
    good = np.concatenate([rows.host_ns[rows.quality[:, 1] == 0] for rows in blocks])
    assert np.diff(good).max() > 500_000_000
