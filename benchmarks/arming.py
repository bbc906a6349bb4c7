"""Time from ``armscope record`` to armed, on the simulated rig: a fresh process each time, embedded and through a daemon.

Armed means that every device is armed and the recording begun: its file ``RUN.mcap.active`` is there. One run beforehand lets Python
keep its bytecode, as it does on any machine that is used more than once.
"""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import tomli_w

from arm_io import read_toml
from benchmarks.end_to_end import CONFIG
from benchmarks.report import report
from benchmarks.zenoh_pair import free_endpoint
from daq.recording.mcap_file.pages import ACTIVE

ROUNDS = 7


def main() -> None:
    """Prints the figures: medians and worst, s."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = folder / "rig.toml"
        table = read_toml(CONFIG / "puma560_sim.toml") | {"name": "bench arming"}
        table |= {"model": str(CONFIG / "models/puma560.toml"), "zenoh": {"endpoint": free_endpoint()}}
        rig.write_text(tomli_w.dumps(table))
        os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        time_to_armed(rig, folder / "first.mcap")
        embedded = [time_to_armed(rig, folder / f"embedded{k}.mcap") for k in range(ROUNDS)]
        daemon = subprocess.Popen(
            [sys.executable, "-m", "armscope", "daemon", "--rig", str(rig)], stderr=subprocess.PIPE, text=True
        )
        assert daemon.stderr is not None
        assert "is open" in daemon.stderr.readline()
        served = [time_to_armed(rig, folder / f"served{k}.mcap") for k in range(ROUNDS)]
        daemon.send_signal(signal.SIGTERM)
        daemon.wait()
    report(
        {
            "record_to_armed_seconds": statistics.median(embedded),
            "record_to_armed_seconds_worst": max(embedded),
            "record_to_armed_through_daemon_seconds": statistics.median(served),
            "record_to_armed_through_daemon_seconds_worst": max(served),
        }
    )


def time_to_armed(rig: Path, out: Path) -> float:
    """Seconds from starting the process to the file's appearance; the run is then ended."""
    experiment = CONFIG / "experiments/excitation.toml"
    active = out.with_name(out.name + ACTIVE)
    begin = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "armscope", "record", "--rig", str(rig), "--experiment", str(experiment), "--out", str(out)],
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    while not active.exists():
        assert process.poll() is None, "the recording ended before it began"
        time.sleep(0.001)
    seconds = time.perf_counter() - begin
    time.sleep(0.1)  # signals are taken as soon as it runs
    process.send_signal(signal.SIGINT)
    process.wait()
    return seconds


if __name__ == "__main__":
    main()
