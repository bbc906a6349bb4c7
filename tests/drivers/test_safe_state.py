"""The T7's own watchdog brings outputs to their safe state when the daemon dies, hangs or loses the T7."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.rig.rig_file import read_rig
from daq.service.client import call
from daq.service.zenoh_session import keys_of, open_session
from sim_backend.protocol import labjack_t7 as simulator
from sim_backend.protocol.wires import Wires
from tests.drivers.lab_rig import write_rig
from tests.ports import free_endpoint

EXPERIMENT = """
name = "stand"
start = [0.0, 0.0]
full_speed = [1.0, 1.0]
full_acceleration = [3.0, 3.0]
[[segment]]
type = "hold"
duration = 60.0
"""
START = 4  # the T7's line
FED = 2.3  # s: longer than the T7's watchdog waits
SAFE = 6.0  # s for the watchdog of 2 s to act, on a busy machine


def still_wires() -> Wires:
    """An arm that stands where the experiment starts, without current."""
    return Wires(counts=lambda channel, at: np.zeros_like(at), volts=lambda channel, at: np.zeros(len(at)))


def becomes(state: Callable[[], Any], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not state():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@contextmanager
def daemon(root: Path, rig: Path) -> Iterator[subprocess.Popen[str]]:
    """``armscope daemon``, open."""
    command = [sys.executable, "-m", "armscope", "daemon", "--rig", str(rig)]
    environment = os.environ | {"PYTHONPATH": str(root)}
    process = subprocess.Popen(command, env=environment, cwd=rig.parent, text=True, stderr=subprocess.PIPE)
    try:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "is open on" in line, line + process.stderr.read()
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("end", ["killed", "stopped", "device lost", "asked to end"])
def test_the_outputs_are_made_safe(tmp_path: Path, root: Path, end: str) -> None:
    path, where = write_rig(tmp_path)
    text = path.read_text().replace("watchdog = 4.0", "watchdog = 1.5").replace("watchdog = 5", "watchdog = 2")
    path.write_text(text + f'[zenoh]\nendpoint = "{free_endpoint()}"\n')
    rig = read_rig(path)
    box = simulator.make("daq", where, still_wires())
    box.open()
    with daemon(root, path) as process, open_session(rig, listen=False) as session:
        order = {"experiment": EXPERIMENT, "out": str(tmp_path / "run.mcap")}
        call(session, keys_of(rig.name), "arm", order, timeout=30.0)
        call(session, keys_of(rig.name), "start", timeout=30.0)
        assert becomes(lambda: box.outputs.get(START) == 1, 20.0), "the start line never rose"
        box.dacs[1] = 1.5  # as if a control voltage were applied
        time.sleep(FED)
        assert box.outputs[START] == 1 and box.tripped == 0  # a running daemon feeds the watchdog
        if end == "killed":
            process.kill()
        elif end == "stopped":
            process.send_signal(signal.SIGSTOP)
        elif end == "device lost":
            box.pull_cable()
        else:
            process.terminate()
        assert becomes(lambda: box.outputs[START] == 0 and box.dacs == [0.0, 0.0], SAFE)
        assert (box.tripped > 0) == (end != "asked to end")
        if end == "stopped":
            stays_safe_when_it_goes_on(process, box, lambda: call(session, keys_of(rig.name), "status", timeout=30.0))
        if end == "asked to end":
            assert process.wait(30.0) == 0
    box.close()


def stays_safe_when_it_goes_on(process: subprocess.Popen[str], box: Any, status: Callable[[], dict[str, Any]]) -> None:
    """A daemon that wakes up again does not undo what the watchdog did: the run is over, and it says why."""
    process.send_signal(signal.SIGCONT)
    assert becomes(lambda: status()["state"] == "idle", 30.0)
    assert box.outputs[START] == 0 and box.dacs == [0.0, 0.0]
    assert "was not active" in status()["tripped"]
