"""The service: one rig, its devices open, waiting for commands; one run at a time.

Three threads. The one that calls ``step`` decides: it takes the commands and owns the state, and does nothing that
takes long, so that ``status`` and ``stop`` are always answered. Another talks to the devices: it arms, starts and takes
the rows (``daq.service.process.worker``). A third reads files for clients. docs/daemon.md has the table of commands;
refusals are ``InputError`` and ``DeviceFault``.
"""

from __future__ import annotations

import hashlib
import os
import threading
import time
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
from daq.service.device_jobs import Armed, DeviceJobs
from daq.service.endpoint import Endpoint
from daq.service.process.heap import return_large_blocks
from daq.service.process.stuck import Stuck
from daq.service.process.systemd import Watchdog
from daq.service.process.worker import Worker
from daq.service.publisher import Publisher
from daq.service.rig_lock import RigLock
from daq.service.run import Run
from daq.service.transfer.served import ServedFolder
from daq.service.zenoh_session import keys_of

Table = dict[str, Any]
STATE_SECONDS = 0.25


class Service:
    """A rig in service, between ``open`` and ``close``. All methods but ``wake`` belong to one thread.

    role     'daemon', or 'record' for the time of one embedded recording
    folder   recordings go only there, by plain file name; must be given where the endpoint is not loopback
    publish  'required': InputError or DeviceFault if the endpoint cannot be had; 'optional': without it, and ``notes``
             says why
    read_chain  reads the links of an arm from its model; a rig with a [space] needs it
    state    idle, arming, armed, disarming or running
    bug      what ended the last run if that was an error in the program; None otherwise
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
        self.state = "idle"
        self.run: Run | None = None
        self.last: Table | None = None
        self.bug: BaseException | None = None
        self._role, self._publish = role, publish
        self._served = ServedFolder(folder)
        self._watchdog = Watchdog()
        self._inbox = CommandQueue()
        self._endpoint: Endpoint | None = None
        self._job: Outcome | None = None  # of the devices: what the state waits for
        self._armed: Armed | None = None
        self._why_disarmed: str | None = None
        self._cancel: str | None = None  # why arming is to end in idle
        self._holding: threading.Thread | None = None  # makes all safe while the devices are being armed
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
            self._open_endpoint()
            self.bench.open()
        except BaseException:
            self.close()
            raise
        self._watchdog.ready(f"rig {self.rig.name}: idle")

    def close(self) -> None:
        """Ends a run with its file finished, makes the rig safe and gives everything back.

        May be called at any time.
        """
        self._watchdog.stopping()
        self.end(End.TERMINATED)
        self._devices.close()
        self._served.close()
        self._answers.settle()
        if self._endpoint is not None:
            self._endpoint.close_commands()
        if hasattr(self, "_jobs"):
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
        if self._armed is not None:
            timeout = min(timeout, max(self._armed.until - time.monotonic(), 0.001))
        command = self._inbox.next(timeout)
        if command is not None:
            self._answer(command)
        self._collect()
        self._sign_of_life()
        due = time.monotonic() - self._published_at > STATE_SECONDS
        if due and self._publisher is not None and self.run is not None:
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
    def bench(self) -> Bench:
        """The devices; while a run goes on they belong to its thread."""
        return self._jobs.bench

    def end(self, reason: End = End.STOPPED) -> None:
        """Ends what is armed or running, and waits until its file is finished."""
        self._stop_all(reason)
        while self.state != "idle":
            time.sleep(0.01)
            self._collect()
            self._sign_of_life()

    # Commands

    def _status(self, arguments: Table) -> Table:
        checked("status", arguments, NoArguments)
        return {
            "state": self.state,
            "rig": self.rig.name,
            "rig_sha256": self.rig_sha256,
            "role": self._role,
            "pid": os.getpid(),
            "endpoint": self.rig.zenoh.endpoint,
            "recordings": None if self._served.folder is None else str(self._served.folder.path),
            "tripped": self.bench.guard.tripped,
            "run": self.run.progress() if self.run is not None else None,
            "expires": None if self._armed is None else max(self._armed.until - time.monotonic(), 0.0),
            "disarmed": self._why_disarmed,
            "last": self.last,
        }

    def _identity(self, arguments: Table) -> Table | Outcome:
        checked("identity", arguments, NoArguments)
        if self.state != "idle":
            return self._jobs.known_identities()
        return self._answers.of(self._devices.submit(self._jobs.identities))

    def _arm(self, arguments: Table) -> Outcome:
        self._refuse_unless_idle("arm")
        request = checked("arm", arguments, ArmArguments)
        if request.rig_sha256 not in (None, self.rig_sha256):
            raise InputError(
                "daemon", f"runs rig '{self.rig.name}' from a file of other content; restart it, or use that file"
            )
        self._why_disarmed = self._cancel = None
        self._job = self._devices.submit(partial(self._armed_by, request, time.monotonic()))
        self._go("arming")
        return self._answers.of(self._job, self._armed_answer)

    def _armed_by(self, request: ArmArguments, asked: float) -> Armed:
        """On the thread of the devices. What they raise because arming was ended is that it was."""
        try:
            return self._jobs.arm(request, self._served.folder, self._publisher, asked)
        except DeviceFault:
            if self._cancel is None:
                raise
            raise InputError("daemon", f"arm: {self._cancel}") from None

    def _start(self, arguments: Table) -> Outcome:
        checked("start", arguments, NoArguments)
        if self.state != "armed" or self.run is None:
            raise InputError("daemon", f"start: is {self.state}; 'arm' comes first")
        started: Outcome = Future()
        started.add_done_callback(lambda _: self.wake())
        self._job = self._devices.submit(partial(self._jobs.run, self.run, started))
        self._armed = None
        self._go("running")
        return self._answers.of(started, lambda _: {"state": "running"})

    def _stop(self, arguments: Table) -> Table | Outcome:
        wait = checked("stop", arguments, StopArguments).wait
        was_armed = self.state in ("armed", "disarming")
        self._stop_all(End.STOPPED)
        if self.state == "idle" or not (wait or was_armed):
            return {"state": self.state}
        return self._answers.at_idle()

    def _disarm(self, arguments: Table) -> Table | Outcome:
        checked("disarm", arguments, NoArguments)
        if self.state == "running":
            raise InputError("daemon", "disarm: is running; 'stop' ends a run")
        self._stop_all(End.STOPPED)
        return {"state": self.state} if self.state == "idle" else self._answers.at_idle()

    def _zero(self, arguments: Table) -> Outcome:
        self._refuse_unless_idle("zero", "not during a run")
        wanted = checked("zero", arguments, ZeroArguments).position
        position = [0.0] * self.rig.joints if wanted is None else wanted
        if len(position) != self.rig.joints:
            raise InputError("daemon", f"zero: position: must be {self.rig.joints} numbers, is {len(position)}")
        return self._answers.of(self._devices.submit(partial(self._jobs.zero, position)))

    def _check(self, arguments: Table) -> Outcome:
        checked("check", arguments, NoArguments)
        self._refuse_unless_idle("check", "not during a run")
        return self._answers.of(self._devices.submit(self._jobs.check))

    def _reset(self, arguments: Table) -> Table:
        checked("reset", arguments, NoArguments)
        self.bench.guard.reset()
        return {"tripped": None}

    # States

    def _go(self, state: str) -> None:
        self.state = state
        self._publish_state()

    def _go_idle(self, result: Table | None = None) -> None:
        """result  of the run that has ended, if one has."""
        self.run = self._armed = None
        self._go("idle")
        self._answers.settle_idle(result)

    def _stop_all(self, reason: End) -> None:
        """Makes for idle from any state. An arm on its way to the start pose is stopped where it is."""
        if self.state == "arming":
            if self._cancel is None:
                self._cancel = "was stopped before it was ready"
                self._holding = self.bench.guard.hold(self._cancel)
        elif self.state == "armed":
            self._leave()
        elif self.run is not None:
            self.run.stop(reason)

    def _leave(self) -> None:
        """From armed to idle."""
        assert self.run is not None
        self._armed = None
        self._job = self._devices.submit(self.run.disarm)
        self._go("disarming")

    def _collect(self) -> None:
        """Takes what the other threads have done, and sends the answers that wait for it."""
        held = self._holding is not None and self._holding.is_alive()
        if self._job is not None and self._job.done() and not held:
            job, self._job = self._job, None
            self._release()
            if self.state == "arming":
                self._armed_now(job)
            else:
                self._ended(job)
        self._answers.settle()
        self._expire()

    def _release(self) -> None:
        """Ends what ``_stop_all`` began while the rig was armed; what else tripped stays."""
        if self._holding is not None and self.bench.guard.tripped == self._cancel:
            self.bench.guard.reset()
        self._holding = None

    def _armed_answer(self, armed: Armed) -> Table:
        if self._cancel is not None:
            raise InputError("daemon", f"arm: {self._cancel}")
        return {"state": self.state, "file": str(armed.run.request.out)}

    def _armed_now(self, job: Outcome) -> None:
        if job.exception() is not None:
            self._go_idle()
            return
        self._armed = job.result()
        self.run = self._armed.run
        self._go("armed") if self._cancel is None else self._leave()

    def _ended(self, job: Outcome) -> None:
        """After a run, or after disarming."""
        error = job.exception()
        if error is not None and not isinstance(error, InputError | DeviceFault):
            self.bug = error
        result = None
        if self.state == "running" and self.run is not None:
            self.last = result = self.run.result
        self._go_idle(result)

    def _expire(self) -> None:
        """An armed rig waits for its client, not for ever."""
        if self._armed is None:
            return
        why = self._armed.lapsed(() if self._endpoint is None else self._endpoint.clients)
        if why is not None:
            self._why_disarmed = why
            self._leave()

    # Inside

    def _answer(self, command: Command) -> None:
        try:
            if command.verb == "arm":
                self._refuse_unless_idle("arm")  # before the experiment is looked at
            arguments = command.arguments()
        except (InputError, DeviceFault) as error:
            command.refuse(error)
            return
        self.obey(command.verb, arguments).add_done_callback(command.settle)

    def _refuse_unless_idle(self, verb: str, why: str = "one run at a time") -> None:
        if self.state == "idle":
            return
        doing = f"is {self.state}" if self.run is None else f"is {self.state} with {self.run.request.out}"
        raise InputError("daemon", f"{verb}: {doing}; {why}")

    def _open_endpoint(self) -> None:
        try:
            self._endpoint = Endpoint(self.rig, self._inbox, self.wake)
        except DeviceFault as fault:
            if self._publish == "required":
                raise
            self.notes.append(f"not published: {fault.what}")

    @property
    def _publisher(self) -> Publisher | None:
        return None if self._endpoint is None else self._endpoint.publisher

    def _sign_of_life(self) -> None:
        """Tells the service manager that all is well, unless a driver hangs."""
        running, tripped = self.state == "running", self.bench.guard.tripped is not None
        if not self._stuck(running=running, tripped=tripped, busy=self._devices.busy_seconds):
            self._watchdog.alive()

    def _publish_state(self) -> None:
        self._published_at = time.monotonic()
        if self._publisher is not None:
            self._publisher.state({"state": self.state, "run": self.run.progress() if self.run else None})
        self._watchdog.status(f"rig {self.rig.name}: {self.state}")
