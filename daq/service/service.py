"""The service: one rig, its devices open, waiting for commands; one run at a time.

Commands come over Zenoh as JSON and are obeyed one after the other by the thread that owns the devices (``step``). A run takes its
rows in a thread of its own, so that ``status`` and ``stop`` are heard while it lasts.

    command   arguments                                    answer
    status    -                                            state, rig, run (while there is one), last (result of the last run)
    identity  -                                            devices: name -> what each says it is, asked anew while idle
    arm       experiment (TOML text), out, [rig_sha256]    state 'armed'
    start     -                                            state 'running'
    stop      -                                            state; an armed run is disarmed, a running one ends with its rows so far
    zero      [position] (J,) rad (m)                      counters set so that the joints read that; 0 where left out
    reset     -                                            the guard takes commands again after it tripped

Refusals are ``InputError`` and ``DeviceFault`` as JSON (``daq.service.client``).
"""

from __future__ import annotations

import hashlib
import os
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import DeviceFault, InputError
from daq.acquisition.states import End
from daq.rig.bench import Bench
from daq.rig.rig_file import Rig, read_rig
from daq.service.command_server import Command, CommandServer
from daq.service.publisher import Publisher
from daq.service.rig_lock import RigLock
from daq.service.ros2_keys import RosPublisher
from daq.service.run import Run, order_of
from daq.service.systemd import Watchdog
from daq.service.zenoh_session import keys_of, open_session

Table = dict[str, Any]
STATE_SECONDS = 0.25
STUCK_SECONDS = 5.0


class Service:
    """A rig in service, between ``open`` and ``close``.

    role     'daemon', or 'record' for the time of one embedded recording
    folder   recordings go only there, by plain file name; wanted where the endpoint is not loopback
    publish  'wanted': InputError or DeviceFault if the endpoint cannot be had; 'welcome': without it, and ``notes`` says why
    """

    def __init__(self, rig_path: Path, *, role: str = "daemon", folder: Path | None = None, publish: str = "wanted"):
        self.rig: Rig = read_rig(rig_path)
        self.rig_text = rig_path.read_text(encoding="utf-8")
        self.rig_sha256 = hashlib.sha256(self.rig_text.encode()).hexdigest()
        self.keys = keys_of(self.rig.name)
        self.notes: list[str] = []
        self.run: Run | None = None
        self.last: Table | None = None
        self.bug: BaseException | None = None
        self._role, self._folder, self._publish = role, folder, publish
        self._watchdog = Watchdog()
        self._taking: threading.Thread | None = None
        self._publisher: Publisher | None = None
        self._commands: CommandServer | None = None
        self._session: Any = None
        self._told = self._tripped = 0.0
        if folder is None and not self.rig.zenoh.loopback and role == "daemon":
            raise InputError(
                "--recordings",
                f"is missing; {self.rig.zenoh.endpoint} is not loopback, and clients may write only there",
            )

    # Life

    def open(self) -> None:
        """Takes the rig, opens its devices and the Zenoh session; all or nothing."""
        self._lock = RigLock(self.rig.name, self._role)
        try:
            self.bench = Bench(self.rig)
            self._open_session()
            self.bench.open()
        except BaseException:
            self.close()
            raise
        self._watchdog.ready(f"rig {self.rig.name}: idle")

    def close(self) -> None:
        """Ends a run with its file finished, makes the rig safe and gives everything back; may be called at any time."""
        self._watchdog.stopping()
        self.end(End.TERMINATED)
        if self._commands is not None:
            self._commands.close()
            self._commands = None
        if hasattr(self, "bench"):
            self.bench.close()
        if self._session is not None:
            self._session.close()
            self._session = None
        self._lock.release()

    def step(self, timeout: float) -> None:
        """Obeys the commands that come within ``timeout`` s, or before the run ends; gives the signs of life."""
        if self._watchdog.interval is not None:
            timeout = min(timeout, self._watchdog.interval)
        if self._commands is None:
            self._wait_for_run(timeout)
        elif (command := self._commands.next(timeout)) is not None:
            self._answer(command)
        self._collect()
        if not self._stuck():
            self._watchdog.alive()
        if self._publisher is not None and time.monotonic() - self._told > STATE_SECONDS and self.run is not None:
            self._tell()

    def wake(self) -> None:
        """Makes ``step`` return; from a signal handler or another thread."""
        if self._commands is not None:
            self._commands.wake()

    @property
    def state(self) -> str:
        """idle, armed or running."""
        return "idle" if self.run is None else "running" if self._taking is not None else "armed"

    # Commands

    def obey(self, verb: str, arguments: Table) -> Table:
        """Runs one command of ``daq.service.client.COMMANDS``; InputError and DeviceFault are refusals."""
        if verb in ("arm", "zero"):
            return (self.arm if verb == "arm" else self.zero)(arguments)
        plain = {
            "status": self.status,
            "identity": self.identity,
            "start": self.start,
            "stop": self.stop,
            "reset": self.reset,
        }
        return plain[verb]()

    def status(self) -> Table:
        """What ``status`` answers."""
        return {
            "state": self.state,
            "rig": self.rig.name,
            "rig_sha256": self.rig_sha256,
            "role": self._role,
            "pid": os.getpid(),
            "endpoint": self.rig.zenoh.endpoint,
            "tripped": self.bench.guard.tripped,
            "run": self.run.progress() if self.run is not None else None,
            "last": self.last,
        }

    def identity(self) -> Table:
        """Every device, asked again while idle; during a run what it said before."""
        self._open_bench()
        return {"devices": {name: asdict(identity) for name, identity in self.bench.identities.items()}}

    def arm(self, arguments: Table) -> Table:
        """Gets everything ready for an experiment, and begins the file."""
        if self.run is not None:
            raise InputError("daemon", f"is {self.state} with {self.run.order.out}; one run at a time")
        if arguments.get("rig_sha256", self.rig_sha256) != self.rig_sha256:
            raise InputError(
                "daemon", f"runs rig '{self.rig.name}' from a file of other content; restart it, or use that file"
            )
        text, out = arguments.get("experiment"), arguments.get("out")
        if not isinstance(text, str) or not isinstance(out, str):
            raise InputError("daemon", "arm: wants 'experiment' (TOML text) and 'out' (a file name)")
        where = str(arguments.get("experiment_file", "experiment"))
        order = order_of(text, where, self._place(out))
        self._open_bench()
        run = Run(self.bench, self.rig_text, order, self._publisher)
        run.arm()
        self.run = run
        self._tell()
        return {"state": self.state, "file": str(order.out)}

    def start(self) -> Table:
        """Starts the armed run."""
        if self.run is None or self._taking is not None:
            raise InputError("daemon", f"start: is {self.state}; 'arm' comes first")
        try:
            self.run.start()
        except DeviceFault:
            self._ended()
            raise
        self._taking = threading.Thread(target=self._take, args=(self.run,), name="acquisition")
        self._taking.start()
        self._tell()
        return {"state": self.state}

    def stop(self) -> Table:
        """Ends what is armed or running."""
        if self.run is not None and self._taking is None:
            self.run.disarm()
            self.run = None
            self._tell()
        elif self.run is not None:
            self.run.stop()
        return {"state": self.state}

    def zero(self, arguments: Table) -> Table:
        """Sets the counters where the arm now stands."""
        if self.run is not None:
            raise InputError("daemon", f"zero: is {self.state}; not during a run")
        position = arguments.get("position", [0.0] * self.rig.joints)
        if not (isinstance(position, list) and len(position) == self.rig.joints):
            raise InputError("daemon", f"zero: 'position' wants {self.rig.joints} numbers")
        try:
            values = np.array(position, float)
        except (TypeError, ValueError):
            raise InputError("daemon", "zero: 'position' wants numbers") from None
        if not np.isfinite(values).all():
            raise InputError("daemon", "zero: 'position' wants finite numbers")
        self._open_bench()
        self.bench.zero(values)
        return {"position": position}

    def reset(self) -> Table:
        """Somebody has looked; the guard takes commands again."""
        self.bench.guard.reset()
        return {"tripped": None}

    def end(self, reason: End = End.STOPPED) -> None:
        """Ends what is armed or running, and waits until its file is finished."""
        if self.run is None:
            return
        if self._taking is None:
            self.stop()
            return
        self.run.stop(reason)
        while self.run is not None:
            self._wait_for_run(STUCK_SECONDS / 10)
            self._collect()
            if not self._stuck():
                self._watchdog.alive()

    # Inside

    def _answer(self, command: Command) -> None:
        try:
            command.answer(self.obey(command.verb, command.arguments()))
        except (InputError, DeviceFault) as error:
            command.refuse(error)

    def _open_session(self) -> None:
        try:
            self._session = open_session(self.rig, listen=True)
        except DeviceFault as fault:
            if self._publish == "wanted":
                raise
            self.notes.append(f"not published: {fault.what}")
            return
        ros = None
        if self.rig.zenoh.ros2_attachment:
            ros = RosPublisher(self._session, self.rig.zenoh.domain, self.keys.name.replace("-", "_"))
        joints = [joint.name or f"joint{number}" for number, joint in enumerate(self.rig.joint, 1)]
        self._publisher = Publisher(self._session, self.keys, joints, ros=ros)
        self._commands = CommandServer(self._session, self.keys)

    def _open_bench(self) -> None:
        """The devices, opened anew after a fault. DeviceFault: one of them is still not there."""
        if not self.bench.identities:
            self.bench.open()

    def _place(self, out: str) -> Path:
        """Where a recording goes. Who is beyond loopback may name files, not folders."""
        if self._folder is None:
            if not Path(out).is_absolute():
                raise InputError("daemon", f"out: {out} is relative; the daemon wants the whole path")
            return Path(out)
        if Path(out).name != out or out.startswith("."):
            raise InputError("daemon", f"out: wants a plain file name; recordings of this daemon go to {self._folder}")
        return self._folder / out

    def _take(self, run: Run) -> None:
        try:
            run.take()
        except Exception as bug:
            self.bug = bug
        finally:
            self.wake()

    def _wait_for_run(self, timeout: float) -> None:
        if self._taking is not None:
            self._taking.join(timeout)
        else:
            time.sleep(timeout)

    def _collect(self) -> None:
        """The result of a run that has ended."""
        if self._taking is not None and not self._taking.is_alive():
            self._taking.join()
            self._taking = None
            self._ended()

    def _ended(self) -> None:
        """A device that failed is closed with all others, and opened anew when it is next wanted."""
        assert self.run is not None
        self.last, self.run = self.run.result, None
        if self.last is None or self.last["ending"]["fault"]:
            self.bench.close()
        self._tell()

    def _stuck(self) -> bool:
        """Whether a run should have ended long ago: a driver hangs. Then only the service manager can help."""
        tripped = self._taking is not None and self.bench.guard.tripped is not None
        self._tripped = (self._tripped or time.monotonic()) if tripped else 0.0
        return tripped and time.monotonic() - self._tripped > STUCK_SECONDS

    def _tell(self) -> None:
        self._told = time.monotonic()
        if self._publisher is not None:
            self._publisher.state({"state": self.state, "run": self.run.progress() if self.run else None})
        self._watchdog.status(f"rig {self.rig.name}: {self.state}")
