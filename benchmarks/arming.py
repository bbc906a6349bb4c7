"""Time from ``armscope record`` to armed, on the simulated rig.

a fresh process each time, embedded and through a daemon.

Armed means that every device is armed and the recording begun: its file ``RUN.mcap.active`` is there. One run
beforehand lets Python keep its bytecode, as it does on any machine that is used more than once. The excitation is then
repeated for a minute, an hour and a day: seconds, and the largest resident memory of the process until it is armed.
"""

from __future__ import annotations

import math
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
from experiment import demand_of, read_experiment

ROUNDS = 7
EXCITATION = CONFIG / "experiments/excitation.toml"
LASTING = {"1min": 60.0, "1h": 3600.0, "24h": 86400.0}


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
        lasting = {}
        for name, seconds in LASTING.items():
            experiment = repeated(folder / f"{name}.toml", seconds)
            lasting[f"arming_seconds_{name}"], lasting[f"arming_rss_mb_{name}"] = armed(
                rig, folder / f"{name}.mcap", experiment
            )
    report(
        {
            **lasting,
            "record_to_armed_seconds": statistics.median(embedded),
            "record_to_armed_seconds_worst": max(embedded),
            "record_to_armed_through_daemon_seconds": statistics.median(served),
            "record_to_armed_through_daemon_seconds_worst": max(served),
        }
    )


def repeated(path: Path, seconds: float) -> Path:
    """The excitation over and over again, for so many seconds at least, as a file."""
    table = read_toml(EXCITATION)
    times = math.ceil(seconds / demand_of(read_experiment(EXCITATION)).duration)
    path.write_text(
        tomli_w.dumps(table | {"segment": [{"type": "repeat", "times": times, "segment": table["segment"]}]})
    )
    return path


def time_to_armed(rig: Path, out: Path) -> float:
    """Seconds from starting the process to the file's appearance; the run is then ended."""
    return armed(rig, out, EXCITATION)[0]


def armed(rig: Path, out: Path, experiment: Path) -> tuple[float, float]:
    """Seconds from starting the process to the file's appearance, and MB of memory that it had at most.

    The run is then ended.
    """
    active = out.with_name(out.name + ACTIVE)
    begin = time.perf_counter()
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "armscope",
            "record",
            "--rig",
            str(rig),
            "--experiment",
            str(experiment),
            "--out",
            str(out),
        ],
        stdout=subprocess.DEVNULL,
    )
    while not active.exists():
        assert process.poll() is None, "the recording ended before it began"
        time.sleep(0.001)
    seconds = time.perf_counter() - begin
    status = Path(f"/proc/{process.pid}/status").read_text()
    peak = float(status[status.index("VmHWM:") :].split()[1]) / 1024
    time.sleep(0.1)  # signals are taken as soon as it runs
    process.send_signal(signal.SIGINT)
    process.wait()
    return seconds, peak


if __name__ == "__main__":
    main()
