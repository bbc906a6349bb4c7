"""Our publisher and subscriber beside Lab Streaming Layer (pylsl), which laboratories use today.

The same channels, the same rate.

14 channels (3 counters, 8 inputs, a point), float64, one sending and one receiving process over loopback, blocks of 10
ms. Paced: 20 kHz for 10 s, CPU of both processes together as a share of one core, and samples lost. Sustained: 2
million samples as fast as they are taken. Rounds of both alternate; medians are compared. LSL carries the samples and a
time a sample; ours also number, wall time and what was missed.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from benchmarks.report import report
from benchmarks.zenoh_pair import free_endpoint
from daq.rig.rig_file import Rig
from daq.service.publisher import Publisher
from daq.service.subscriber import Subscriber
from daq.service.zenoh_session import keys_of, open_session

RATE, BLOCK, CHANNELS = 20_000, 200, 14
PACED, SUSTAINED, ROUNDS = 10 * RATE, 2_000_000, 3


def main() -> None:
    """Prints the figures."""
    rounds: dict[str, list[dict[str, float]]] = {"ours": [], "lsl": []}
    for _ in range(ROUNDS):
        for peer, measured in rounds.items():
            measured.append(measure(peer))
    figures = {
        f"{peer}_{name}": statistics.median(one[name] for one in measured)
        for peer, measured in rounds.items()
        for name in measured[0]
    }
    ratios = {
        "zenoh_sustained_rate_vs_lsl": figures["ours_sustained_samples_per_s"] / figures["lsl_sustained_samples_per_s"],
        "zenoh_core_share_vs_lsl": figures["ours_core_share_at_20khz"] / figures["lsl_core_share_at_20khz"],
    }
    report(figures | ratios)


def measure(peer: str) -> dict[str, float]:
    """A paced and a sustained stream between two fresh processes."""
    paced, sustained = stream(peer, PACED, True), stream(peer, SUSTAINED, False)
    return {
        "core_share_at_20khz": paced["cpu"] / paced["seconds"],
        "lost_at_20khz": PACED - paced["received"],
        "sustained_samples_per_s": sustained["received"] / sustained["seconds"],
        "lost_sustained": SUSTAINED - sustained["received"],
    }


def stream(peer: str, samples: int, paced: bool) -> dict[str, float]:
    """One stream; CPU seconds of both processes, and what the receiver got in how long."""
    name = f"bench{os.getpid()}"
    arguments = [peer, name, free_endpoint(), str(samples), str(int(paced))]
    command = [sys.executable, "-m", "benchmarks.lsl_peer"]
    sender = subprocess.Popen(
        [*command, "--send", *arguments], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    )
    receiver = None
    try:
        assert sender.stdout is not None
        assert sender.stdout.readline() == "ready\n"
        receiver = subprocess.Popen([*command, "--receive", *arguments], stdout=subprocess.PIPE, text=True)
        got = json.loads(receiver.communicate(timeout=120)[0])
        sent = json.loads(sender.communicate("end\n", timeout=60)[0])
    finally:
        for process in filter(None, (sender, receiver)):
            process.kill()
            process.wait()
    return {"received": got["received"], "seconds": got["seconds"], "cpu": got["cpu"] + sent["cpu"]}


def send(peer: str, name: str, endpoint: str, samples: int, paced: bool) -> None:
    """The sending process."""
    values = np.random.default_rng(1).normal(size=(BLOCK, CHANNELS))
    push, watched = (lsl_sender if peer == "lsl" else our_sender)(name, endpoint, values, paced)
    print("ready", flush=True)
    while not watched():
        time.sleep(0.001)
    before, begin = cpu(), time.monotonic()
    for block in range(samples // BLOCK):
        if paced:
            time.sleep(max(begin + block * BLOCK / RATE - time.monotonic(), 0))
        push(block)
    spent = cpu() - before
    sys.stdin.readline()
    print(json.dumps({"cpu": spent}))


def lsl_sender(name: str, _: str, values: np.ndarray, __: bool) -> tuple[Callable[[int], None], Callable[[], bool]]:
    import pylsl

    info = pylsl.StreamInfo(name, "bench", CHANNELS, RATE, pylsl.cf_double64, name)
    outlet = pylsl.StreamOutlet(info, BLOCK, 3600)
    return lambda _: outlet.push_chunk(values), outlet.have_consumers


def our_sender(
    name: str, endpoint: str, values: np.ndarray, paced: bool
) -> tuple[Callable[[int], None], Callable[[], bool]]:
    session = open_session(rig(name, endpoint), listen=True)
    publisher = Publisher(session, keys_of(name), ["joint1"], reliable=not paced)
    columns = {"counts": values[:, :3].copy(), "volts": values[:, 3:11].copy(), "points": values[:, 11:].copy()}
    number = np.arange(BLOCK)

    def push(block: int) -> None:
        publisher.publish({"number": number + block * BLOCK, "wall_ns": number * 50_000} | columns)

    return push, lambda: not session.is_closed() and publisher.watched


def receive(peer: str, name: str, endpoint: str, samples: int) -> None:
    """The receiving process; its time and CPU count from the first samples on."""
    received, began, before = (lsl_receiver if peer == "lsl" else our_receiver)(name, endpoint, samples)
    print(json.dumps({"received": received, "seconds": time.monotonic() - began, "cpu": cpu() - before}))


def lsl_receiver(name: str, _: str, samples: int) -> tuple[int, float, float]:
    import pylsl

    (info,) = pylsl.resolve_byprop("name", name, timeout=30)
    inlet = pylsl.StreamInlet(info, 3600, BLOCK)
    inlet.open_stream(30)
    buffer = np.empty((BLOCK, CHANNELS))
    received, began, before = 0, 0.0, 0.0
    while received < samples:
        _, stamps = inlet.pull_chunk(5.0, BLOCK, dest_obj=buffer)
        if not stamps:
            break
        if not received:
            began, before = time.monotonic(), cpu()
        received += len(stamps)
    return received, began, before


def our_receiver(name: str, endpoint: str, samples: int) -> tuple[int, float, float]:
    with open_session(rig(name, endpoint), listen=False) as session, Subscriber(session, keys_of(name)) as subscriber:
        received, began, before = 0, 0.0, 0.0
        while received < samples:
            block = subscriber.receive()
            assert block is not None
            if not received:
                began, before = time.monotonic(), cpu()
            received = subscriber.tally.received + subscriber.tally.missed
        return subscriber.tally.received, began, before


def rig(name: str, endpoint: str) -> Rig:
    return Rig.model_validate({"name": name, "joint": [{}], "zenoh": {"endpoint": endpoint}})


def cpu() -> float:
    """CPU seconds of this process, all threads."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    if "--send" in sys.argv or "--receive" in sys.argv:
        peer, name, endpoint, samples, paced = sys.argv[2:7]
        if sys.argv[1] == "--send":
            send(peer, name, endpoint, int(samples), paced == "1")
        else:
            receive(peer, name, endpoint, int(samples))
    else:
        main()
