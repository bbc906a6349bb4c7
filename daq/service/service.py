"""The service: one rig, its devices open, waiting for commands; one run at a time.

Three threads. The one that calls ``step`` decides: it takes the commands and owns the state (``lifecycle``), and does
nothing that takes long, so that ``status`` and ``stop`` are always answered. Another talks to the devices: it arms,
starts and takes the rows (``process.worker``). A third reads files for clients. docs/daemon.md has the table of
commands; refusals are ``InputError`` and ``DeviceFault``.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Container
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, cast

from arm_io import DeviceFault, InputError, read_text
from daq.acquisition.states import End
from daq.rig.bench import Bench
from daq.rig.preflight import ChainReader, chain_of
from daq.rig.rig_file import Rig, read_rig
from daq.service.commands.answers import Outcome, PendingAnswers
from daq.service.commands.arguments import ArmArguments, NoArguments, StopArguments, ZeroArguments, checked
from daq.service.commands.queue import CommandQueue
from daq.service.commands.server import Command
from daq.service.device_jobs import DeviceJobs
from daq.service.endpoint import Endpoint
from daq.service.lifecycle import Lifecycle
from daq.service.process.heap import return_large_blocks
from daq.service.process.stuck import Stuck
from daq.service.process.systemd import Watchdog
from daq.service.process.worker import Worker
from daq.service.publisher import Publisher
from daq.service.rig_lock import RigLock
from daq.service.transfer.served import ServedFolder
from daq.service.zenoh_session import keys_of

Table = dict[str, Any]
STATE_SECONDS = 0.25
"""s between published states."""


class Service:
    """A rig in service, between ``open`` and ``close``. All methods but ``wake`` belong to one thread.

    role     'daemon', or 'record' for the time of one embedded recording
    folder   recordings go only there, by plain file name; must be given where the endpoint is not loopback
    publish  'required': InputError or DeviceFault if the endpoint cannot be had; 'optional': without it, and ``notes``
             says why
    read_chain  reads the links of an arm from its model; a rig with a [space] needs it
    """

    def __init__(
        self,
        rig_path: Path,
        *,
        role: str = "daemon",
        folder: Path | None = None,
        publish: str = "required",
        read_chain: ChainReader | None = None,
    ):
        self.rig: Rig = read_rig(rig_path)
        self._chain = chain_of(self.rig, read_chain)
        self.rig_text = read_text(rig_path)
        self.rig_sha256 = hashlib.sha256(self.rig_text.encode()).hexdigest()
        self.keys = keys_of(self.rig.name)
        self.notes: list[str] = []
        self._role, self._publish = role, publish
        self._served = ServedFolder(folder)
        self._watchdog = Watchdog()
        self._inbox = CommandQueue()
        self._endpoint: Endpoint | None = None
        self._lifecycle: Lifecycle | None = None
        self._answers = PendingAnswers()
        self._stuck = Stuck()
        self._published_at = 0.0
        if folder is None and not self.rig.zenoh.loopback and role == "daemon":
            raise InputError(
                "--recordings",
                f"is missing; {self.rig.zenoh.endpoint} is not loopback, and clients may write only there",
            )

    # Life

    def open(self) -> None:
        """Takes the rig, opens its devices and the Zenoh session; all or nothing."""
        return_large_blocks()
        self._lock = RigLock(self.rig.name, self._role)
        self._devices = Worker("devices", self.wake)
        self._served.open(self.wake)
        try:
            self._jobs = DeviceJobs(self.rig, self.rig_text, self._chain)
            self._lifecycle = Lifecycle(self._jobs, self._devices, self._answers, self._publish_state)
            self._open_endpoint()
            self.bench.open()
        except BaseException:
            self.close()
            raise
        self._watchdog.ready(f"rig {self.rig.name}: idle")

    def close(self) -> None:
        """Ends a run and finishes its file, makes the rig safe, and releases all devices. May be called at any time."""
        self._watchdog.stopping()
        if self._lifecycle is not None:
            self.end(End.TERMINATED)
        self._devices.close()
        self._served.close()
        self._answers.settle()
        if self._endpoint is not None:
            self._endpoint.close_commands()
        if self._lifecycle is not None:
            self.bench.close()
        if self._endpoint is not None:
            self._endpoint.close()
            self._endpoint = None
        self._lock.release()

    def step(self, timeout: float) -> None:
        """Obeys the next command that comes within ``timeout`` s; gives the signs of life.

        Returns early when a job is done.
        """
        if self._watchdog.interval is not None:
            timeout = min(timeout, self._watchdog.interval)
        if self.lifecycle.armed is not None:
            timeout = min(timeout, max(self.lifecycle.armed.until - time.monotonic(), 0.001))
        command = self._inbox.next(timeout)
        if command is not None:
            self._answer(command)
        self.lifecycle.collect(self._clients)
        self._sign_of_life()
        due = time.monotonic() - self._published_at > STATE_SECONDS
        if due and self._publisher is not None and self.lifecycle.run is not None:
            self._publish_state()

    def wake(self) -> None:
        """Makes ``step`` return; from a signal handler or another thread."""
        self._inbox.wake()

    def obey(self, verb: str, arguments: Table | None = None) -> Outcome:
        """Begins to obey one command of ``daq.service.client.COMMANDS``; ``step`` completes what takes longer."""
        outcome: Outcome = Future()
        try:
            served = verb in ("recordings", "checksum", "read")
            begin = getattr(self._served, verb) if served else getattr(self, f"_{verb}")
            result = begin(arguments or {})
            if isinstance(result, Future):
                return result
            outcome.set_result(result)
        except Exception as error:
            outcome.set_exception(error)
        return outcome

    def ask(self, verb: str, arguments: Table | None = None) -> Table:
        """As ``obey``, waiting for the answer; commands of other clients are obeyed meanwhile."""
        outcome = self.obey(verb, arguments)
        while not outcome.done():
            self.step(0.05)
        return cast(Table, outcome.result())

    @property
    def lifecycle(self) -> Lifecycle:
        """State and run of the rig, which must be open."""
        assert self._lifecycle is not None, "the service is not open"
        return self._lifecycle

    @property
    def bench(self) -> Bench:
        """The devices; while a run goes on they belong to its thread."""
        return self._jobs.bench

    def end(self, reason: End = End.STOPPED) -> None:
        """Ends what is armed or running, and waits until its file is finished."""
        self.lifecycle.stop(reason)
        while self.lifecycle.state != "idle":
            time.sleep(0.01)
            self.lifecycle.collect(self._clients)
            self._sign_of_life()

    # Commands

    def _status(self, arguments: Table) -> Table:
        checked("status", arguments, NoArguments)
        run, armed = self.lifecycle.run, self.lifecycle.armed
        return {
            "state": self.lifecycle.state,
            "rig": self.rig.name,
            "rig_sha256": self.rig_sha256,
            "role": self._role,
            "pid": os.getpid(),
            "endpoint": self.rig.zenoh.endpoint,
            "recordings": None if self._served.folder is None else str(self._served.folder.path),
            "tripped": self.bench.guard.tripped,
            "run": None if run is None else run.progress(),
            "expires": None if armed is None else max(armed.until - time.monotonic(), 0.0),
            "disarmed": self.lifecycle.why_disarmed,
            "last": self.lifecycle.last,
        }

    def _identity(self, arguments: Table) -> Table | Outcome:
        checked("identity", arguments, NoArguments)
        if self.lifecycle.state != "idle":
            return self._jobs.known_identities()
        return self._answers.of(self._devices.submit(self._jobs.identities))

    def _arm(self, arguments: Table) -> Outcome:
        self.lifecycle.refuse_unless_idle("arm")
        request = checked("arm", arguments, ArmArguments)
        if request.rig_sha256 not in (None, self.rig_sha256):
            raise InputError(
                "daemon", f"runs rig '{self.rig.name}' from a file of other content; restart it, or use that file"
            )
        asked = time.monotonic()
        return self.lifecycle.arm(partial(self._jobs.arm, request, self._served.folder, self._publisher, asked))

    def _start(self, arguments: Table) -> Outcome:
        checked("start", arguments, NoArguments)
        return self.lifecycle.start(self.wake)

    def _stop(self, arguments: Table) -> Table | Outcome:
        wait = checked("stop", arguments, StopArguments).wait
        was_armed = self.lifecycle.state in ("armed", "disarming")
        self.lifecycle.stop(End.STOPPED)
        if self.lifecycle.state == "idle" or not (wait or was_armed):
            return {"state": self.lifecycle.state}
        return self._answers.at_idle()

    def _disarm(self, arguments: Table) -> Table | Outcome:
        checked("disarm", arguments, NoArguments)
        if self.lifecycle.state == "running":
            raise InputError("daemon", "disarm: is running; 'stop' ends a run")
        self.lifecycle.stop(End.STOPPED)
        return {"state": "idle"} if self.lifecycle.state == "idle" else self._answers.at_idle()

    def _zero(self, arguments: Table) -> Outcome:
        self.lifecycle.refuse_unless_idle("zero", "not during a run")
        wanted = checked("zero", arguments, ZeroArguments).position
        position = [0.0] * self.rig.joints if wanted is None else wanted
        if len(position) != self.rig.joints:
            raise InputError("daemon", f"zero: position: must be {self.rig.joints} numbers, is {len(position)}")
        return self._answers.of(self._devices.submit(partial(self._jobs.zero, position)))

    def _check(self, arguments: Table) -> Outcome:
        checked("check", arguments, NoArguments)
        self.lifecycle.refuse_unless_idle("check", "not during a run")
        return self._answers.of(self._devices.submit(self._jobs.check))

    def _reset(self, arguments: Table) -> Table:
        checked("reset", arguments, NoArguments)
        self.bench.guard.reset()
        return {"tripped": None}

    # Inside

    def _answer(self, command: Command) -> None:
        try:
            if command.verb == "arm":
                self.lifecycle.refuse_unless_idle("arm")  # before the experiment is looked at
            arguments = command.arguments()
        except (InputError, DeviceFault) as error:
            command.refuse(error)
            return
        self.obey(command.verb, arguments).add_done_callback(command.settle)

    def _open_endpoint(self) -> None:
        try:
            self._endpoint = Endpoint(self.rig, self._inbox, self.wake)
        except DeviceFault as fault:
            if self._publish == "required":
                raise
            self.notes.append(f"not published: {fault.what}")

    @property
    def _clients(self) -> Container[str]:
        """Names of the liveliness tokens that are there."""
        return () if self._endpoint is None else self._endpoint.clients

    @property
    def _publisher(self) -> Publisher | None:
        return None if self._endpoint is None else self._endpoint.publisher

    def _sign_of_life(self) -> None:
        """Tells the service manager that all is well, unless a driver hangs."""
        running, tripped = self.lifecycle.state == "running", self.bench.guard.tripped is not None
        if not self._stuck(running=running, tripped=tripped, busy=self._devices.busy_seconds):
            self._watchdog.alive()

    def _publish_state(self) -> None:
        self._published_at = time.monotonic()
        if self._publisher is not None:
            run = self.lifecycle.run
            self._publisher.state({"state": self.lifecycle.state, "run": run.progress() if run else None})
        self._watchdog.status(f"rig {self.rig.name}: {self.lifecycle.state}")
