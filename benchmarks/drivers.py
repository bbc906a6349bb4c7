"""Rates of the drivers against the limits of their wires: ``python -m benchmarks.drivers [--json] [NAME ...]``.

Each device is simulated in a process of its own, at the pace of its wire. NAME_rate_vs_wire is good rows made over the
rows that the wire could carry in the same time (NAME_median_rate_vs_wire: by the median interval of rows, for devices
that are asked one row at a time, which a busy machine keeps waiting); NAME_rate_vs_transport its rows over those of a
bare loop on the same line, in turns of a quarter of a second: what of a request-and-reply line's rate the driver
leaves; NAME_cpu the share of one core that the driver took for it; NAME_edge_to_row_us the median time from a row's
trigger to the row in the program, and ..._p99_us its 99th percentile: those of devices that are read in blocks, every
10 ms here, are of the blocks. ``*_decode`` are parsers alone, in memory.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import multiprocessing
import os
import resource
import select
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from drivers import RigContext
from drivers.can_bus import frame_bits
from drivers.protocols import Block, EdgeSource, Plan, Quality

SECONDS = 3.0
SET_TIMER_SLACK = 29  # prctl(2)


def signal_counts(channel: int, at: np.ndarray) -> np.ndarray:
    return np.rint(20_000 * np.sin((channel + 1) * at * 1e-9)).astype(np.int64)


def signal_volts(channel: int, at: np.ndarray) -> np.ndarray:
    return 3.0 * np.cos((channel + 1) * at * 1e-9)


def serve(driver: str, options: dict[str, Any], ready: Any, stop: Any) -> None:
    """The simulator's process."""
    from sim_backend.protocol.wires import Wires

    ctypes.CDLL(None).prctl(SET_TIMER_SLACK, 1, 0, 0, 0)  # a device's timer is not 50 us late, as a sleeping process is
    config = importlib.import_module(f"drivers.{driver}").Config.model_validate(options)
    box = importlib.import_module(f"sim_backend.protocol.{driver}").make(
        driver, config, Wires(counts=signal_counts, volts=signal_volts)
    )
    box.open()
    ready.set()
    if hasattr(box, "start"):
        time.sleep(0.3)
        box.start(time.monotonic_ns())
    stop.wait()
    box.close()


@contextmanager
def device(driver: str, **options: Any) -> Iterator[Any]:
    """An open device of this driver, its simulator at the other end."""
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Event(), context.Event()
    process = context.Process(target=serve, args=(driver, options, ready, stop))
    process.start()
    try:
        if not ready.wait(20):
            raise RuntimeError(f"the simulator of {driver} did not start")
        module = importlib.import_module(f"drivers.{driver}")
        box = module.make(driver, module.Config.model_validate(options), RigContext())
        box.open()
        yield box
        box.close()
    finally:
        stop.set()
        process.join(10)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def measure(name: str, take: Callable[[], Block], limit: float, every: float) -> dict[str, float]:
    """``take`` every so many s, or (0) again and again, for SECONDS.

    Good rows per second against ``limit``, CPU, latency.
    """
    take()
    begun, cpu = time.monotonic(), _cpu()
    rows, ages, took = 0, [], []
    while (now := time.monotonic()) - begun < SECONDS:
        block = take()
        good = int(np.count_nonzero(~(block.quality & (Quality.MISSING | Quality.LATE)).any(axis=1)))
        rows += good
        took += [time.monotonic_ns()] * (good > 0)
        if good and block.host[-1]:
            ages.append((time.monotonic_ns() - block.host) * 1e-3)
        if every:
            time.sleep(every - (time.monotonic() - begun) % every)
    seconds = now - begun
    figures = {f"{name}_rows_per_s": rows / seconds, f"{name}_rate_vs_wire": rows / seconds / limit}
    if rows == len(took) and not every:
        figures[f"{name}_median_rate_vs_wire"] = 1e9 / float(np.median(np.diff(took))) / limit
    figures[f"{name}_cpu"] = (_cpu() - cpu) / seconds
    if ages:
        all_ages = np.concatenate(ages)
        figures[f"{name}_edge_to_row_us"] = float(np.median(all_ages))
        figures[f"{name}_edge_to_row_p99_us"] = float(np.percentile(all_ages, 99))
    return figures


def _cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def labjack_t7() -> dict[str, float]:
    """The T7's stream at its ceiling of 100 000 samples/s: 8 AIN, 3 encoders, CORE_TIMER."""
    where = {"host": "127.0.0.1", "port": free_port(), "stream_port": free_port()}
    with device("labjack_t7", **where) as t7:
        rate = t7.scan.fastest
        t7.arm(Plan(EdgeSource.TIMER, rate, None))
        return measure("t7", t7.read, rate, 0.01)


def labjack_t7_decode() -> dict[str, float]:
    """Stream bytes to scans, in memory, against 100 000 samples/s."""
    from drivers.labjack_t7 import protocol as t7

    scan = t7.ScanList(tuple(range(8)), (0, 2, 6))
    samples = np.random.default_rng(1).integers(0, 65535, 32 * scan.slots).astype(np.uint16)
    data = b"".join(t7.encode_packet(k, t7.Packet(0, 0, 0, samples)) for k in range(100))
    stream, begun, count = t7.Stream(scan), time.perf_counter(), 0
    while time.perf_counter() - begun < 1.0:
        count += len(stream.feed(data).number) * scan.slots
    return {"t7_decode_vs_wire": count / (time.perf_counter() - begun) / t7.SAMPLES_PER_SECOND}


def us_digital_qsb() -> dict[str, float]:
    """All that a QSB can send at 230400 baud; polled 1000 times per second for its newest count."""
    from drivers.us_digital_qsb import protocol as qsb

    with tempfile.TemporaryDirectory() as folder, device("us_digital_qsb", port=f"{folder}/qsb") as counter:
        counter.arm(Plan(EdgeSource.POLL, 1000.0, None))
        received = 0
        feed = counter._replies.feed

        def counted(data: bytes) -> list[Any]:
            nonlocal received
            replies: list[Any] = feed(data)
            received += len(replies)
            return replies

        counter._replies.feed = counted
        begun = time.monotonic()
        figures = measure("qsb", counter.poll, 1000.0, 0.001)
        figures["qsb_rate_vs_asked"] = figures["qsb_rate_vs_wire"]
        figures["qsb_rate_vs_wire"] = received / (time.monotonic() - begun) / qsb.STREAM_RATE
        return figures


def us_digital_ad4b() -> dict[str, float]:
    """Question and answer at 9600 baud."""
    from drivers.us_digital_ad4b import protocol as ad4b

    with tempfile.TemporaryDirectory() as folder, device("us_digital_ad4b", port=f"{folder}/ad4b") as counter:
        counter.arm(Plan(EdgeSource.POLL, 100.0, None))
        figures = measure("ad4b", counter.poll, ad4b.RATE, 0.0)
        port = counter._port._alive().fileno()

        def bare() -> bool:
            os.write(port, ad4b.POSITION)
            got = b""
            while len(got) < ad4b.POSITION_BYTES and select.select([port], [], [], 1.0)[0]:
                got += os.read(port, ad4b.POSITION_BYTES)
            return len(got) == ad4b.POSITION_BYTES

        def driver() -> bool:
            return not (counter.poll().quality & Quality.MISSING).any()

        return figures | {"ad4b_rate_vs_transport": in_turns(driver, bare)}


def in_turns(driver: Callable[[], bool], bare: Callable[[], bool], turn: float = 0.25) -> float:
    """Rows of ``driver`` over those of ``bare`` in the same time.

    They are taken in turns, so that a busy machine keeps both waiting. Each says whether it made one.
    """
    rows = {driver: 0, bare: 0}
    for _ in range(round(2 * SECONDS / turn)):
        for once in (driver, bare):
            end = time.monotonic() + turn
            while time.monotonic() < end:
                rows[once] += once()
    return rows[driver] / rows[bare]


def cia406() -> dict[str, float]:
    """One encoder at 125 kbit/s and six at 500 kbit/s.

    The bus is one of Unix sockets whose frames take as long as their bits: asked row by row, which leaves the wire idle
    while the host turns round, and by the SYNCs of a node (X_synced), at 99 % of the wire, where a busy machine's
    simulated node leaves some out (X_synced_good: the share of good rows among those of the SYNCs that it made).
    """
    figures = {}
    for name, nodes, bitrate in (("cia406", [1], 125_000), ("cia406_6_nodes", [1, 2, 3, 4, 5, 6], 500_000)):
        with tempfile.TemporaryDirectory() as folder:
            bus = {"interface": "unix", "channel": folder, "bitrate": bitrate}
            with device("cia406", nodes=nodes, timeout=0.05, **bus) as encoders:
                encoders.arm(Plan(EdgeSource.POLL, 100.0, None))
                figures |= measure(name, encoders.poll, encoders.max_rate, 0.0)
            with device("cia406", nodes=nodes, sync=1, **bus) as encoders:
                figures |= by_syncs(f"{name}_synced", encoders)
    return figures


def by_syncs(name: str, encoders: Any) -> dict[str, float]:
    """Rows by the SYNCs of a node, at 99 % of the wire."""
    encoders.arm(Plan(EdgeSource.TIMER, 0.99 * encoders.max_rate, None))
    blocks: list[Block] = []

    def take() -> Block:
        blocks.append(encoders.read())
        return blocks[-1]

    figures = measure(name, take, encoders.max_rate, 0.01)
    encoders.disarm()
    host, quality = (np.concatenate([getattr(block, column) for block in blocks]) for column in ("host", "quality"))
    figures[f"{name}_median_rate_vs_wire"] = 1e9 / float(np.median(np.diff(host))) / encoders.max_rate
    figures[f"{name}_good"] = float((quality & (Quality.MISSING | Quality.LATE) == 0).all(axis=1).mean())
    return figures


def isabellenhuette_ivts() -> dict[str, float]:
    """Six sensors with a result every ms, the fastest there is, over a bus of Unix sockets.

    Polled 1000 times per second for the newest. ivts_rate_vs_sent: results taken over those that the sensors make in
    the time; ivts_taken_vs_sent by the counters in the frames.
    """
    sensors = [{"command": 0x411 + k, "reply": 0x451 + k, "result": 0x521 + 16 * k} for k in range(6)]
    options = {"sensors": sensors, "period": 1, "timeout": 1.0, "interface": "unix"}
    with tempfile.TemporaryDirectory() as folder, device("isabellenhuette_ivts", channel=folder, **options) as currents:
        currents.arm(Plan(EdgeSource.POLL, 1000.0, None))
        taken, lost = (sum(getattr(box, name) for box in currents._results) for name in ("taken", "lost"))
        begun = time.monotonic()
        figures = measure("ivts", currents.poll, 1000.0, 0.001)
        figures["ivts_rate_vs_asked"] = figures.pop("ivts_rate_vs_wire")
        taken = sum(box.taken for box in currents._results) - taken
        lost = sum(box.lost for box in currents._results) - lost
        figures["ivts_results_per_s"] = taken / (time.monotonic() - begun)
        figures["ivts_rate_vs_sent"] = figures["ivts_results_per_s"] / (1000 * len(sensors))
        return figures | {"ivts_taken_vs_sent": taken / (taken + lost)}


def isabellenhuette_ivts_decode() -> dict[str, float]:
    """Results a second through the .dbc, against a 1 Mbit/s bus full of them."""
    from drivers.isabellenhuette_ivts import protocol as ivt

    results, begun, count = ivt.Results(), time.perf_counter(), 0
    frames = [bytes([0, k % 16, 0, 0, 3, k % 256]) for k in range(1600)]
    while time.perf_counter() - begun < 1.0:
        for frame in frames:
            results.take(frame)
        count += len(frames)
    return {"ivts_decode_vs_wire": count / (time.perf_counter() - begun) / (1e6 / frame_bits(ivt.RESULT_BYTES))}


def tracker_stream() -> dict[str, float]:
    """A tracker at 1000 points/s over UDP."""
    with device("tracker_stream", port=free_port()) as tracker:
        tracker.arm(Plan(EdgeSource.TRACKER, 1000.0, None))
        deadline = time.monotonic() + 10
        while not len(tracker.read()) and time.monotonic() < deadline:
            time.sleep(0.01)
        return measure("tracker", tracker.read, 1000.0, 0.01)


def linux_counter() -> dict[str, float]:
    """Three channels from files like sysfs' (real registers behind a bus are slower to read)."""
    with tempfile.TemporaryDirectory() as folder, device("linux_counter", sysfs=folder) as counter:
        counter.arm(Plan(EdgeSource.POLL, 1000.0, None))
        return measure("linux_counter", counter.poll, 1000.0, 0.0)


BENCHMARKS = [
    labjack_t7,
    labjack_t7_decode,
    us_digital_qsb,
    us_digital_ad4b,
    cia406,
    isabellenhuette_ivts,
    isabellenhuette_ivts_decode,
    tracker_stream,
    linux_counter,
]


def main() -> None:
    names = [a for a in sys.argv[1:] if a != "--json"]
    figures: dict[str, float] = {}
    for benchmark in BENCHMARKS:
        if not names or benchmark.__name__ in names:
            figures |= benchmark()
    if "--json" in sys.argv:
        print(json.dumps(figures))
    else:
        print("\n".join(f"{name:<36}{value:12.4g}" for name, value in figures.items()))


if __name__ == "__main__":
    main()
