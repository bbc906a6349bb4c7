"""Those who share the daemon with the soak.

``python -m tests.soak.crowd KIND RIG.toml SEED`` until SIGTERM, then what it did, as JSON.

visitors   subscribers that come, listen for a while and go, some without a word (their process ends)
wedged     subscribers that stop reading (SIGSTOP), then go on or are killed
liars      put rubbish on the rig's keys, declare its tokens and command keys as their own, send bytes that are no Zenoh
           to its port
fuzzers    commands with every kind of wrong argument; each must be answered by a result or a typed error
"""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from arm_io import DeviceFault
from daq.rig.rig_file import Rig, read_rig
from daq.service.client import call
from daq.service.subscriber import Subscriber
from daq.service.zenoh_session import keys_of, open_session

SLOW = 2.0
"""s for an answer, from where on it is counted as slow."""


class Crowd:
    """What one kind of guest does in one visit, and how often it did what."""

    def __init__(self, rig: Rig, path: str, dice: random.Random) -> None:
        self.rig, self.path, self.dice, self.keys = rig, path, dice, keys_of(rig.name)
        self.did: Counter[str] = Counter()
        self.slowest = 0.0

    def visitors(self) -> None:
        """One subscriber; its count of rows received and missed must go with the blocks' own."""
        if self.dice.random() < 0.2:
            sleeper = _sleeper(self.path)
            time.sleep(self.dice.uniform(0.1, 1.0))
            sleeper.kill()
            sleeper.wait()
            self.did["killed"] += 1
            return
        latest = self.dice.choice([None, 1, 20])
        with open_session(self.rig, listen=False) as session, Subscriber(session, self.keys, latest=latest) as rows:
            end = time.monotonic() + self.dice.uniform(0.1, 3.0)
            while time.monotonic() < end:
                if (block := rows.receive(0.1)) is not None:
                    self.did["rows"] += block.rows
                if latest == 20:
                    time.sleep(0.05)
            self.did["visits"] += 1
            self.did["rows missed"] += rows.tally.missed

    def wedged(self) -> None:
        sleeper = _sleeper(self.path)
        assert sleeper.stdout is not None
        sleeper.stdout.readline()
        os.kill(sleeper.pid, signal.SIGSTOP)
        time.sleep(self.dice.uniform(1.0, 5.0))
        if self.dice.random() < 0.5:
            os.kill(sleeper.pid, signal.SIGCONT)
            time.sleep(0.5)
        sleeper.kill()
        sleeper.wait()
        self.did["wedged"] += 1

    def liars(self) -> None:
        self._shout_at_the_port()
        with open_session(self.rig, listen=False) as session:
            keys = [self.keys.rows, self.keys.joint_states, self.keys.state, self.keys.alive, self.keys.command("stop")]
            for _ in range(50):
                session.put(self.dice.choice([*keys, "armscope/**", "somebody/else"]), self._rubbish(5000))
                self.did["puts"] += 1
            tokens = [session.liveliness().declare_token(self.keys.client(f"liar{k}")) for k in range(50)]
            tokens.append(session.liveliness().declare_token(self.keys.alive))
            mine = session.declare_queryable(self.keys.command("*"), lambda query: query.reply(query.key_expr, b"{}"))
            self.did["tokens"] += len(tokens)
            time.sleep(0.2)
            if self.dice.random() < 0.5:
                mine.undeclare()
                for token in tokens:
                    token.undeclare()
        time.sleep(0.3)

    def fuzzers(self) -> None:
        unanswered = 0
        with open_session(self.rig, listen=False) as session:
            daemon = call(session, self.keys, "status")["pid"]
            for _ in range(20):
                verb, payload = self._command()
                begun, answers = time.monotonic(), 0
                for reply in session.get(self.keys.command(verb), payload=payload, timeout=10.0):
                    kind = "answered" if reply.ok is not None else "refused"
                    if reply.err is not None and b"a bug" in reply.err.payload.to_bytes():
                        kind = f"a bug: {verb}: {reply.err.payload.to_bytes().decode(errors='replace')[:200]}"
                    elif reply.err is not None and b'"error"' not in reply.err.payload.to_bytes():
                        kind = "untyped"
                    self.did[kind] += 1
                    answers += 1
                unanswered += not answers
                took = time.monotonic() - begun
                self.slowest = max(self.slowest, took)
                self.did["slow"] += took > SLOW
                self.did["sent"] += 1
                time.sleep(self.dice.uniform(0.0, 0.05))
            if call(session, self.keys, "status")["pid"] == daemon:  # else it was killed meanwhile
                self.did["unanswered"] += unanswered

    def _command(self) -> tuple[str, bytes]:
        """Nothing that would be obeyed but for ``zero`` and questions: who may stop a run may stop it."""
        dice = self.dice
        deep = dice.choice([b"[", b'{"a":']) * 5000
        payloads: list[bytes] = [
            b"",
            b"{}",
            b"null",
            b"[]",
            b"{",
            b"\xff\xfe",
            deep,
            self._rubbish(1000),
            b'{"position": 1e400}',
            b"NaN",
            b'{"position": [NaN, 0, 0, 0, 0, 0]}',
            b'{"position": [' + b"9" * 400 + b"]}",
            b'{"wait": 1}',
            b"0" * 100_000,
            b'{"experiment": "", "out": ""}',
            b'{"experiment": 5, "out": "/x"}',
            b'{"out": "\\u0000"}',
            b'{"name": "../x"}',
            json.dumps({"experiment": "a = " + "[" * 5000, "out": "/tmp/x"}).encode(),
            json.dumps({"experiment": "rate = inf", "out": "/tmp/" + "x" * 300}).encode(),
            json.dumps({"experiment": 'name = "n"', "out": "/tmp/\ud800"}).encode(),
            b'{"experiment": "' + b"x" * 5_000_000 + b'"}',
        ]
        verbs = ["status", "identity", "arm", "zero", "reset", "recordings", "checksum", "read", "nonsense", "a" * 300]
        return dice.choice(verbs), dice.choice(payloads)

    def _shout_at_the_port(self) -> None:
        """Connections that send what is no Zenoh, or nothing, and go or stay a while."""
        host, _, port = self.rig.zenoh.endpoint.partition("/")[2].rpartition(":")
        opened = []
        for _ in range(self.dice.randint(1, 10)):
            try:
                connection = socket.create_connection((host, int(port)), 1.0)
            except OSError:
                break
            opened.append(connection)
            if self.dice.random() < 0.7:
                connection.sendall(self._rubbish(3000))
        self.did["connections"] += len(opened)
        time.sleep(self.dice.uniform(0.0, 0.5))
        for connection in opened:
            connection.close()

    def _rubbish(self, most: int) -> bytes:
        return self.dice.randbytes(self.dice.randint(0, most))


def _sleeper(path: str) -> subprocess.Popen[bytes]:
    """A subscriber in a process of its own, which says when it listens."""
    return subprocess.Popen([sys.executable, "-m", "tests.soak.crowd", "sleeper", path, "0"], stdout=subprocess.PIPE)


def sleep_and_listen(rig: Rig) -> None:
    with open_session(rig, listen=False) as session, Subscriber(session, keys_of(rig.name)) as rows:
        print("ready", flush=True)
        while True:
            rows.receive()


def main(kind: str, path: str, seed: int) -> None:
    rig = read_rig(path, drivers=False)
    if kind == "sleeper":
        sleep_and_listen(rig)
    signals: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: signals.append(number))
    crowd = Crowd(rig, str(Path(path)), random.Random(seed))
    visit: Callable[[], None] = getattr(crowd, kind)
    while not signals:
        try:
            visit()
        except (DeviceFault, OSError):
            crowd.did["nobody there"] += 1  # the daemon was killed just now
            time.sleep(0.2)
        except Exception as error:
            if type(error).__name__ != "ZError":
                raise
            crowd.did["session lost"] += 1
            time.sleep(0.2)
    result: dict[str, Any] = {"kind": kind, "slowest": crowd.slowest, **crowd.did}
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
