"""A rig of serial counters in a run: a cable pulled and put back, one device's and everybody's."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.ledger import LossReason
from daq.acquisition.states import End
from daq.rig.bench import open_bench
from daq.rig.rig_file import read_rig
from drivers.protocols import Quality
from drivers.us_digital_ad4b import device as us_digital_ad4b
from drivers.us_digital_qsb import device as us_digital_qsb
from sim_backend.protocol import us_digital_ad4b as sim_ad4b
from sim_backend.protocol import us_digital_qsb as sim_qsb
from tests.drivers.swing import swing_wires

RIG = """
name = "serial-{run}"
[trigger]
source = "poll"
device = "waist"
rate = 100.0
[[device]]
name = "waist"
driver = "drivers.us_digital_qsb"
port = "{folder}/waist"
[[device]]
name = "elbow"
driver = "drivers.us_digital_ad4b"
port = "{folder}/elbow"
[[joint]]
encoder = {{ device = "waist", channel = 0, lines = 1000, preset = 0 }}
[[joint]]
encoder = {{ device = "elbow", channel = 0, lines = 1000, preset = 0 }}
"""
SECONDS = 3.0  # a cable is pulled at 0.4 s; a busy machine needs another second to find its devices again


@pytest.mark.parametrize("pulled", ["one", "all"])
def test_what_is_missing_is_marked_and_what_is_lost_is_in_the_ledger(tmp_path: Path, pulled: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG.format(run=os.getpid(), folder=tmp_path))
    waist = sim_qsb.make("waist", us_digital_qsb.Config(port=f"{tmp_path}/waist"), swing_wires())
    elbow = sim_ad4b.make("elbow", us_digital_ad4b.Config(port=f"{tmp_path}/elbow"), swing_wires())

    def pull() -> None:
        waist.pull_cable()
        if pulled == "all":
            elbow.pull_cable()
        time.sleep(0.5)
        waist.plug_cable()
        if pulled == "all":
            elbow.plug_cable()

    for box in (waist, elbow):
        box.open()
    with open_bench(read_rig(path)) as bench:
        acquisition = Acquisition(bench, seconds=SECONDS)
        acquisition.arm()
        acquisition.start()
        threading.Timer(0.4, pull).start()
        blocks = list(acquisition.rows())
    for box in (waist, elbow):
        box.close()
    assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE
    quality, number = (np.concatenate([getattr(rows, name) for rows in blocks]) for name in ("quality", "number"))
    summary = acquisition.ledger.summary()
    assert summary.triggers == SECONDS * 100 == len(number) + summary.lost
    assert not ((quality & Quality.MISSING) != 0).all(axis=1).any()  # a row without any value is none
    gone = sum(loss.rows for loss in summary.losses if loss.reason is LossReason.DEVICE_GONE)
    if pulled == "all":
        assert gone > 30
    else:
        assert np.count_nonzero(quality[:, 0] & Quality.MISSING) > 30
    # USB is the QSB's power: its counts began anew, and say so to the end.
    assert quality[-1, 0] & Quality.DEVICE_RESET and not quality[-1, 1] & Quality.DEVICE_RESET
