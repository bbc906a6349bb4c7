"""A client that asks and never reads its answers keeps nobody else waiting: a real process, stopped by SIGSTOP."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from daq.service.client import call
from tests.daq.laboratory import Lab

FLOOD = """
import time
from pathlib import Path
import zenoh
from daq.rig.rig_file import read_rig
from daq.service.zenoh_session import keys_of, open_session
rig = read_rig(Path("rig.toml"), drivers=False)
key, session = keys_of(rig.name).command("read"), open_session(rig, listen=False)
print("ready", flush=True)
while True:
    session.get(key, lambda reply: None, payload=b'{"name": "big.mcap"}', timeout=60.0,
                congestion_control=zenoh.CongestionControl.BLOCK)
    time.sleep(0.0002)
"""


def test_a_client_that_does_not_read_its_answers(lab: Lab) -> None:
    """Its connection is closed after a second; before, the daemon did not hear anybody for five."""
    there = lab.folder / "there"
    there.mkdir()
    (there / "big.mcap").write_bytes(os.urandom(1 << 20))
    lab.patient()
    lab.experiment(60)
    lab.daemon("--recordings", "there")
    flood = subprocess.Popen(
        [sys.executable, "-c", FLOOD], cwd=lab.folder, env=lab.environment(), text=True, stdout=subprocess.PIPE
    )
    lab.processes.append(flood)
    assert flood.stdout is not None
    assert flood.stdout.readline() == "ready\n"
    with lab.session() as session:
        call(session, lab.keys, "arm", {"experiment": (lab.folder / "experiment.toml").read_text(), "out": "run.mcap"})
        call(session, lab.keys, "start")
        flood.send_signal(signal.SIGSTOP)
        worst, begun = 0.0, time.monotonic()
        while (now := time.monotonic()) - begun < 4.0:
            assert call(session, lab.keys, "status", timeout=30.0)["state"] == "running"
            worst = max(worst, time.monotonic() - now)
        assert worst < 2.0
        last = call(session, lab.keys, "stop", {"wait": True}, timeout=30.0)["last"]
    assert (last["ending"]["reason"], last["ledger"]["lost"]) == ("stopped", 0)
