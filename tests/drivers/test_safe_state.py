"""Outputs go to their safe state when the program dies, hangs, or loses the device: by the T7's own watchdog, seen at the T7."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from sim_backend.protocol import labjack_t7 as simulator
from tests.drivers.lab_rig import PROGRAM, write_rig
from tests.drivers.swing import swing_wires


def wait_for(state: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not state():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.parametrize("end", ["killed", "stopped", "device lost", "asked to end"])
def test_the_start_line_falls(tmp_path: Path, root: Path, end: str) -> None:
    path, where = write_rig(tmp_path)
    box = simulator.make("daq", where, swing_wires())
    box.open()
    program = subprocess.Popen([sys.executable, "-c", PROGRAM, str(path)], cwd=root, stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    try:
        assert wait_for(lambda: box.outputs.get(4) == 1, 20.0), "the start line never rose"
        program.stdout.readline()
        box.dacs[1] = 1.5  # as if a control voltage stood there
        time.sleep(2.3)
        assert box.outputs[4] == 1 and box.tripped == 0  # a running program feeds the watchdog
        if end == "killed":
            program.kill()
        elif end == "stopped":
            program.send_signal(signal.SIGSTOP)
        elif end == "device lost":
            box.pull_cable()
        else:
            program.send_signal(signal.SIGINT)
        assert wait_for(lambda: box.outputs[4] == 0 and box.dacs == [0.0, 0.0], 5.0)
        assert (box.tripped > 0) == (end != "asked to end")
    finally:
        program.kill()
        program.wait()
        box.close()
