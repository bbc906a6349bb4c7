"""A rig file of one simulated T7."""

from __future__ import annotations

import os
from pathlib import Path

from drivers.labjack_t7 import device as labjack_t7
from tests.ports import free_port

RIG = """
name = "t7-{run}"
watchdog = 4.0
[trigger]
source = "timer"
device = "daq"
rate = 500.0
[[device]]
name = "daq"
driver = "drivers.labjack_t7"
host = "127.0.0.1"
port = {port}
stream_port = {stream_port}
counters = [0, 2]
inputs = [0, 1]
watchdog = 5
timeout = 0.3
patience = {patience}
[outputs.start]
device = "daq"
line = "start"
[[joint]]
encoder = {{ device = "daq", channel = 0, lines = 1000, preset = 0 }}
current = {{ device = "daq", channel = 0, rated_current = 10.0, rated_voltage = 10.0 }}
[[joint]]
encoder = {{ device = "daq", channel = 1, lines = 1000, preset = 0 }}
"""


def write_rig(folder: Path, patience: float = 3.0) -> tuple[Path, labjack_t7.Config]:
    """The rig file, and its T7's Config for a simulator."""
    port, stream_port = free_port(), free_port()
    path = folder / "rig.toml"
    path.write_text(RIG.format(run=os.getpid(), port=port, stream_port=stream_port, patience=patience))
    where = labjack_t7.Config(
        host="127.0.0.1", port=port, stream_port=stream_port, counters=(0, 2), inputs=(0, 1), watchdog=5
    )
    return path, where
