"""The soak itself: run after run through a daemon, each with a fault, and the account of all."""

from __future__ import annotations

import contextlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from arm_io import DeviceFault, InputError
from daq.service.client import call, claim
from daq.service.subscriber import Subscriber
from daq.service.zenoh_session import keys_of, open_session
from tests.soak import judge
from tests.soak.rig import GONE, LONG, SHORT, SoakRig, experiment, write_rig

Table = dict[str, Any]
CROWD = ("visitors", "wedged", "liars", "fuzzers")
KINDS = ("plain", "plain", "stopped", "device lost", "disk slow", "disk full", "abandoned")
WARM_UP, MOST_GROWTH = 60.0, 20.0  # s after which memory must be flat, and MB by which it may still rise
LOST = ("device_lost", "no_answer", "watchdog")  # how a run may end whose device is lost
DEVICE_BACK = 10.0  # s, for which a lost device may stay away
SLOW_DISK, FULL_DISK = 0.7, 2_000_000  # s a call that waits for the disk; bytes that a file may have
LEAST_LIFE, MOST_LIFE = 180.0, 3600.0  # s, after which a daemon is killed and started again; else a third of the soak


@dataclass
class Account:
    """What happened. ``wrong``: every sentence in it is a failure."""

    runs: Counter[str] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    triggers: int = 0
    recorded: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    subscriber: Counter[str] = field(default_factory=Counter)
    killed_rows: list[int] = field(default_factory=list)
    delays: list[int] = field(default_factory=list)  # of the disk, in each run that met a slow one
    slowest_answer: float = 0.0
    memory: list[list[tuple[float, float]]] = field(default_factory=list)  # per life: s since it began, MB when idle
    crowd: list[Table] = field(default_factory=list)


class Soak:
    """``go`` for some seconds; the account is in ``account``."""

    def __init__(self, root: Path, folder: Path, seed: int) -> None:
        self.root, self.folder = root, folder
        self.dice = random.Random(seed)
        self.account = Account()
        self.rig: SoakRig = write_rig(root, folder)
        self.keys = keys_of(self.rig.rig.name)
        self.out = folder / "run.mcap"
        self._delay, self._waits = folder / "delay", folder / "delay.waits"  # the second: a byte per delayed call
        self._crowd: list[subprocess.Popen[str]] = []

    def go(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        life = min(MOST_LIFE, max(seconds / 3, LEAST_LIFE))
        self.daemon = self._start_daemon()
        try:
            self._crowd = [
                self._process("tests.soak.crowd", kind, self.rig.path, self.dice.randint(0, 999)) for kind in CROWD
            ]
            while True:
                self._life(min(time.monotonic() + life, end))
                if time.monotonic() > end:
                    break
                self.daemon = self._start_daemon()
        finally:
            self.daemon.kill()
            for guest in self._crowd:
                guest.terminate()
            for guest in self._crowd:
                self._ask_guest(guest)

    def _start_daemon(self) -> subprocess.Popen[str]:
        return self._process("tests.soak.daemon", self.rig.path, self._delay, stderr=self.folder / "daemon.log")

    def _life(self, until: float) -> None:
        """One daemon, from its start until it is killed in the middle of a run."""
        began, self._memory = time.monotonic(), psutil.Process(self.daemon.pid)
        self.account.memory.append([])
        self._wait_for_daemon()
        kinds: list[str] = []
        while time.monotonic() < until:
            kinds = kinds or self.dice.sample(KINDS, len(KINDS))
            self._one(kinds.pop())
            self.account.memory[-1].append((time.monotonic() - began, self._memory.memory_info().rss / 1e6))
        self._one("killed")

    def _one(self, kind: str) -> None:
        self.account.runs[kind] += 1
        for path in (self.out, self.out.with_name(self.out.name + ".active")):
            path.unlink(missing_ok=True)
        try:
            with open_session(self.rig.rig, listen=False) as session, Subscriber(session, self.keys) as rows:
                self._session = session
                listener = threading.Thread(target=self._listen, args=(rows,), daemon=True)
                self._listening = True
                listener.start()
                try:
                    self._run(kind)
                finally:
                    self._listening = False
                    listener.join()
        except (InputError, DeviceFault) as error:
            self._wrong(f"{kind}: {error}")
        if self.daemon.poll() is not None and kind != "killed":
            raise AssertionError(f"{kind}: the daemon has ended: {(self.folder / 'daemon.log').read_text()[-2000:]}")

    def _run(self, kind: str) -> None:
        if kind == "abandoned":
            with claim(self._session, self.keys) as client:
                self._arm(LONG, client=client)
            self._until_idle()
            return
        with self._disk(kind):
            self._arm(SHORT if kind in ("plain", "disk slow", "disk full") else LONG)
            self._ask("start")
            if kind in ("stopped", "killed"):
                self._wait(self.dice.uniform(0.3, 0.8 * GONE))
            if kind == "killed":
                self._kill()
                return
            if kind == "stopped":
                self._ask("stop")
            last = self._until_idle()["last"]
        self._judge(kind, last)

    @contextlib.contextmanager
    def _disk(self, kind: str) -> Iterator[None]:
        """The daemon's disk: slow, full, or as it is."""
        if kind == "disk full":
            resource.prlimit(self.daemon.pid, resource.RLIMIT_FSIZE, (FULL_DISK, resource.RLIM_INFINITY))
        self._waits.write_bytes(b"")
        self._delay.write_text(str(SLOW_DISK) if kind == "disk slow" else "")
        try:
            yield
        finally:
            self._delay.write_text("")
            if kind == "disk full":
                resource.prlimit(self.daemon.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)

    def _judge(self, kind: str, last: Table) -> None:
        account = self.account
        for fault in judge.imbalance(last):
            self._wrong(f"{kind}: {fault}")
        account.ends[f"{kind}: {last['ending']['reason']}"] += 1
        if kind == "device lost" and last["ending"]["reason"] not in LOST:
            self._wrong(f"{kind}: ended by {last['ending']['reason']}")
        if self.out.exists():
            for fault in judge.finished(self.out, last):
                self._wrong(f"{kind}: {fault}")
            if kind == "disk slow":
                # One after each batch of rows, which may be several chunks where the disk is slow, and one at the end.
                delays = len(self._waits.read_bytes())
                account.delays.append(delays)
                if delays < 2:
                    self._wrong(f"{kind}: the disk was waited for {delays} times with a delay")
        elif kind == "disk full":
            faults, _ = judge.unfinished(self.out.with_name(self.out.name + ".active"), 0)
            for fault in faults:
                self._wrong(f"{kind}: {fault}")
        else:
            self._wrong(f"{kind}: no file")
        account.triggers += last["ledger"]["triggers"]
        account.recorded += last["ledger"]["recorded"]
        for loss in last["ledger"]["losses"]:
            account.lost[loss["reason"]] += loss["rows"]
        self._compare_subscriber(kind, last["published"]["rows"])

    def _compare_subscriber(self, kind: str, published: int) -> None:
        """What the soak's own subscriber received and missed must be what was published."""
        end = time.monotonic() + 5
        while not self._tally.complete and time.monotonic() < end:
            time.sleep(0.01)
        tally = self._tally
        self.account.subscriber["rows"] += tally.received
        self.account.subscriber["missed"] += tally.missed
        if tally.complete and tally.joined + tally.received + tally.missed != published:
            self._wrong(f"{kind}: {published} rows published, a subscriber counts {tally}")
        self.account.subscriber["ends not seen"] += not tally.complete

    def _kill(self) -> None:
        """kill -9 in a run; what its file still holds; the account of it."""
        recorded = self._ask("status")["run"]["recorded"]
        self.daemon.send_signal(signal.SIGKILL)
        self.daemon.wait()
        faults, fewer = judge.unfinished(self.out.with_name(self.out.name + ".active"), recorded)
        self.account.killed_rows.append(fewer)
        for fault in faults:
            self._wrong(f"killed: {fault}")

    # The daemon

    def _arm(self, seconds: float, **more: Any) -> None:
        """Arms; a guard that has tripped is reset first, and a device that was lost may take a while to be back."""
        if self._ask("status")["tripped"]:
            self._ask("reset")
        end = time.monotonic() + DEVICE_BACK
        while True:
            try:
                self._ask("arm", {"experiment": experiment(seconds), "out": str(self.out)} | more, timeout=120.0)
                return
            except DeviceFault as fault:
                if fault.device != "counter" or time.monotonic() > end:
                    raise
                time.sleep(0.1)

    def _ask(self, verb: str, arguments: Table | None = None, timeout: float = 30.0) -> Table:
        begun = time.monotonic()
        answer = call(self._session, self.keys, verb, arguments, timeout=timeout)
        if verb != "arm":
            self.account.slowest_answer = max(self.account.slowest_answer, time.monotonic() - begun)
        return answer

    def _until_idle(self) -> Table:
        while (status := self._ask("status"))["state"] != "idle":
            time.sleep(0.05)
        return status

    def _wait(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end and self._ask("status")["state"] == "running":
            time.sleep(0.05)

    def _wait_for_daemon(self) -> None:
        end = time.monotonic() + 60
        while time.monotonic() < end:
            with contextlib.suppress(DeviceFault), open_session(self.rig.rig, listen=False) as session:
                call(session, self.keys, "status")
                return
            assert self.daemon.poll() is None, (self.folder / "daemon.log").read_text()[-2000:]
            time.sleep(0.1)
        raise AssertionError("the daemon does not answer")

    def _listen(self, rows: Subscriber) -> None:
        self._tally = rows.tally
        while self._listening:
            rows.receive(0.05)

    # Processes

    def _process(self, module: str, *arguments: Any, stderr: Path | None = None) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", module, *map(str, arguments)]
        environment = os.environ | {"PYTHONPATH": str(self.root)}
        with open(stderr or self.folder / "crowd.log", "a") as log:
            return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, env=environment)

    def _ask_guest(self, guest: subprocess.Popen[str]) -> None:
        try:
            out, _ = guest.communicate(timeout=60)
            result = json.loads(out.splitlines()[-1])
        except (subprocess.TimeoutExpired, ValueError, IndexError):
            guest.kill()
            self._wrong(f"one of the crowd failed: {(self.folder / 'crowd.log').read_text()[-500:]}")
            return
        self.account.crowd.append(result)
        for what, times in result.items():
            if times and (what.startswith("a bug") or what in ("untyped", "unanswered")):
                self._wrong(f"{result['kind']}: {times} x {what}")

    def _wrong(self, sentence: str) -> None:
        self.account.wrong.append(sentence)
        print(f"WRONG: {sentence}", file=sys.stderr, flush=True)
