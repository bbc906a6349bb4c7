"""Our subscriber against a bare Zenoh pair that carries the same bytes.

Two processes over loopback TCP; blocks of 200 rows (10 ms at 20 kHz) of 3 counters, 8 inputs, a tracker and 6 joints,
encoded beforehand and sent as fast as the receiver takes them (congestion control BLOCK, so that nothing is dropped).
The bare receiver takes the bytes of each message and counts them; ours makes arrays of them and accounts for every row.
Rounds alternate; rates and ratios are medians over the rounds. Beside it: the whole pair, with our publisher encoding
every block and sending JointStates.
"""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys
import time
import uuid
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.report import report
from daq.acquisition.rows import Rows
from daq.rig.rig_file import Rig
from daq.service.publisher import Publisher
from daq.service.row_block import Columns, columns_of, describe, encode
from daq.service.subscriber import QUEUE_BLOCKS, Subscriber
from daq.service.zenoh_session import keys_of, open_session

if TYPE_CHECKING:
    import zenoh

ROWS, BLOCKS, ROUNDS = 200, 3000, 11
JOINTS = [f"joint{joint}" for joint in range(1, 7)]


def block() -> Columns:
    """200 rows of the rig that the end-to-end benchmark runs."""
    random = np.random.default_rng(1)
    number = np.arange(ROWS)
    q, i, demand = random.normal(size=(3, ROWS, 6))
    counts, volts = random.integers(0, 2**24, (ROWS, 3)), random.normal(size=(ROWS, 8))
    quality, points = np.zeros((ROWS, 12), np.uint8), random.normal(size=(ROWS, 3))
    return columns_of(Rows(number, number, number, number, counts, volts, quality, q, i, points, demand))


def free_endpoint() -> str:
    """A loopback endpoint that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def rig() -> Rig:
    """A rig that is only an endpoint."""
    return Rig.model_validate({"name": "bench", "joint": [{}] * 6, "zenoh": {"endpoint": free_endpoint()}})


def send(table: Rig, encoded: bool) -> None:
    """The sending process: waits for the subscriber, sends all blocks, ends with its standard input."""
    import zenoh

    keys, columns, run = keys_of(table.name), block(), uuid.uuid4()
    with open_session(table, listen=True) as session:
        ours = Publisher(session, keys, JOINTS, reliable=True)
        bare = session.declare_publisher(keys.rows, congestion_control=zenoh.CongestionControl.BLOCK)
        described = describe(columns, JOINTS)
        payloads = [encode(columns, described, run, k, k * ROWS, last=False) for k in range(BLOCKS if encoded else 0)]
        print("ready", flush=True)
        while not ours.watched:
            time.sleep(0.001)
        for k in range(BLOCKS):
            if encoded:
                bare.put(payloads[k])
            else:
                ours.publish(columns)
        sys.stdin.read()


def receive(*, encoded: bool, bare: bool) -> float:
    """Rows/s of one round, from the first block received to the last."""
    table = rig()
    command = [sys.executable, "-m", "benchmarks.zenoh_pair", "--send", table.model_dump_json(), str(int(encoded))]
    sender = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert sender.stdout is not None
        assert sender.stdout.readline() == b"ready\n"
        with open_session(table, listen=False) as session:
            seconds = (_bare if bare else _ours)(session, table)
        sender.communicate()
    finally:
        sender.kill()
        sender.wait()
    return ROWS * (BLOCKS - 1) / seconds


def _bare(session: zenoh.Session, table: Rig) -> float:
    from zenoh.handlers import FifoChannel

    with session.declare_subscriber(keys_of(table.name).rows, FifoChannel(QUEUE_BLOCKS)) as subscriber:
        size = len(subscriber.recv().payload.to_bytes())
        start = time.perf_counter()
        for _ in range(BLOCKS - 1):
            size += len(subscriber.recv().payload.to_bytes())
        return time.perf_counter() - start


def _ours(session: zenoh.Session, table: Rig) -> float:
    with Subscriber(session, keys_of(table.name)) as subscriber:
        subscriber.receive()
        start = time.perf_counter()
        for _ in range(BLOCKS - 1):
            subscriber.receive()
        seconds = time.perf_counter() - start
        assert (subscriber.tally.received, subscriber.tally.missed) == (ROWS * BLOCKS, 0)
    return seconds


def main() -> None:
    """Prints the figures."""
    rounds = [
        (
            receive(encoded=True, bare=False),
            receive(encoded=True, bare=True),
            receive(encoded=False, bare=False),
        )
        for _ in range(ROUNDS)
    ]
    ours, bare, pair = (statistics.median(rates) for rates in zip(*rounds))
    report(
        {
            "zenoh_subscriber_rows_per_s": ours,
            "zenoh_bare_pair_rows_per_s": bare,
            "zenoh_publisher_and_subscriber_rows_per_s": pair,
            "zenoh_subscriber_vs_bare_pair": statistics.median(a / b for a, b, _ in rounds),
            "zenoh_publisher_and_subscriber_vs_bare_pair": statistics.median(c / b for _, b, c in rounds),
        }
    )


if __name__ == "__main__":
    if "--send" in sys.argv:
        send(Rig.model_validate(json.loads(sys.argv[2])), sys.argv[3] == "1")
    else:
        main()
