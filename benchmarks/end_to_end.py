"""The whole service under load: simulated rig -> sampler -> file and Zenoh, at 1, 5 and 20 kHz for 60 s each.

3 counters, 8 analogue inputs and the tracker of ``config/puma560_sim_20khz.toml``, six joints moving; a subscriber in
another process counts every row. Rows lost: triggers without a row in the file, and rows that the subscriber missed.

The simulation runs in the same process, because its devices do. Its cost is taken where it arises: every call into a
simulated device is timed with its thread's CPU clock, and subtracted from the CPU time of the process (all threads:
sampler, recorder, zstd, fsync, Zenoh). What remains is what a rig of real cards would cost, without their drivers.

``--seconds S`` shortens the runs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from arm_io import read_toml
from benchmarks.report import report
from benchmarks.zenoh_pair import free_endpoint
from daq.rig.bench import Bench
from daq.rig.rig_file import read_rig
from daq.service.service import Service
from daq.service.subscriber import Subscriber
from daq.service.zenoh_session import keys_of, open_session

CONFIG = Path(__file__).resolve().parent.parent / "config"
RATES = (1000, 5000, 20000)
DEVICE_CALLS = ("read", "read_edges", "poll", "recall", "finished", "demand")


def main() -> None:
    """Prints the figures."""
    seconds = float(sys.argv[sys.argv.index("--seconds") + 1]) if "--seconds" in sys.argv else 60.0
    figures: dict[str, float] = {"end_to_end_seconds": seconds}
    with tempfile.TemporaryDirectory() as folder:
        for rate in RATES:
            figures |= measure(Path(folder), rate, seconds)
    report(figures)


def measure(folder: Path, rate: int, seconds: float) -> dict[str, float]:
    """One run: rows, losses, shares of one core."""
    rig = folder / f"rig_{rate}.toml"
    table = read_toml(CONFIG / "puma560_sim_20khz.toml")
    table |= {"name": f"bench {rate}", "model": str(CONFIG / "models/puma560.toml")}
    table |= {"zenoh": {"endpoint": free_endpoint()}}
    rig.write_text(tomli_w.dumps(table))
    service = Service(rig)
    service.open()
    spent = time_devices(service.bench)
    listener = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.end_to_end", "--listen", str(rig)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert listener.stdout is not None
        assert listener.stdout.readline() == "ready\n"
        service.ask("arm", {"experiment": experiment(rate, seconds), "out": str(folder / f"{rate}.mcap")})
        spent.clear()
        wall, cpu = time.monotonic(), time.process_time()
        service.ask("start")
        while service.lifecycle.state != "idle":
            service.step(0.5)
        wall, cpu = time.monotonic() - wall, time.process_time() - cpu
        simulation = sum(spent)
        tally = json.loads(listener.communicate(timeout=60)[0])
    finally:
        listener.kill()
        service.close()
    last = service.lifecycle.last
    assert last is not None
    if tally["missed"] or tally["joined"] or not tally["complete"]:
        print(f"at {rate} Hz the subscriber says: {tally}", file=sys.stderr)
    if last["ending"]["fault"]:
        print(f"at {rate} Hz: {last['ending']['sentence']}", file=sys.stderr)
    name = f"end_to_end_{rate // 1000}khz"
    return {
        f"{name}_rows": last["rows"],
        f"{name}_rows_lost": last["ledger"]["lost"],
        f"{name}_rows_missed_by_subscriber": last["published"]["rows"] - tally["received"],
        f"{name}_core_share": (cpu - simulation) / wall,
        f"{name}_core_share_of_simulation": simulation / wall,
    }


def time_devices(bench: Bench) -> list[float]:
    """Has every call into a device append its CPU seconds to the list returned."""
    spent: list[float] = []

    def timed(call: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any) -> Any:
            begin = time.thread_time()
            try:
                return call(*arguments)
            finally:
                spent.append(time.thread_time() - begin)

        return measured

    for device in bench.devices.values():
        for name in DEVICE_CALLS:
            if hasattr(device, name):
                setattr(device, name, timed(getattr(device, name)))
    return spent


def experiment(rate: int, seconds: float) -> str:
    """Six joints in motion for so long: the excitation's Fourier series."""
    table = read_toml(CONFIG / "experiments/excitation.toml")
    (series,) = [segment for segment in table["segment"] if segment["type"] == "fourier"]
    periods = max(round(seconds * series["fundamental"]), 1)
    table["segment"] = [series | {"duration": periods / series["fundamental"]}]
    return tomli_w.dumps(table | {"rate": float(rate)})


def listen(rig_file: str) -> None:
    """The other process: receives until the run is complete."""
    rig = read_rig(rig_file, drivers=False)
    with open_session(rig, listen=False) as session, Subscriber(session, keys_of(rig.name)) as subscriber:
        print("ready", flush=True)
        checked = 0
        while not subscriber.tally.complete:
            block = subscriber.receive(10)
            if block is None:
                break
            checked += int(np.count_nonzero(block.columns["number"] >= 0))
        print(json.dumps(vars(subscriber.tally)))


if __name__ == "__main__":
    if "--listen" in sys.argv:
        listen(sys.argv[2])
    else:
        main()
