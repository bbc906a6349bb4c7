"""The states of a rig in service: idle, arming, armed, disarming, running; one run at a time.

What takes long is done on the thread of the devices; ``collect`` takes its result and goes on to the next state.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Container
from concurrent.futures import Future
from functools import partial
from typing import Any

from arm_io import DeviceFault, InputError
from daq.acquisition.states import End
from daq.service.commands.answers import Outcome, PendingAnswers
from daq.service.device_jobs import Armed, DeviceJobs
from daq.service.process.worker import Worker
from daq.service.run import Run

Table = dict[str, Any]


class Lifecycle:
    """From idle to a run and back. All methods belong to the thread of the service; ``changed`` is told every state.

    state         idle, arming, armed, disarming or running
    run           the run that is armed or goes on; ``armed``: until when it waits for its start
    last          result of the last run; bug: what ended it if that was an error in the program
    why_disarmed  why the last armed run is armed no more, where no client ended it
    """

    def __init__(self, jobs: DeviceJobs, devices: Worker, answers: PendingAnswers, changed: Callable[[], None]) -> None:
        self.state = "idle"
        self.run: Run | None = None
        self.armed: Armed | None = None
        self.last: Table | None = None
        self.bug: BaseException | None = None
        self.why_disarmed: str | None = None
        self._jobs, self._devices, self._answers, self._changed = jobs, devices, answers, changed
        self._job: Outcome | None = None  # of the devices: what the state waits for
        self._cancelled: str | None = None  # why arming is to end in idle
        self._holding: threading.Thread | None = None  # makes all safe while the devices are being armed

    def arm(self, begin: Callable[[], Armed]) -> Outcome:
        """Arms by ``begin``, on the thread of the devices; the answer: state and file."""
        self.why_disarmed = self._cancelled = None
        self._job = self._devices.submit(partial(self._armed_by, begin))
        self._go("arming")
        return self._answers.of(self._job, self._armed_answer)

    def start(self, wake: Callable[[], None]) -> Outcome:
        """Starts the armed run; ``wake`` is called once it goes on, or does not."""
        if self.state != "armed" or self.run is None:
            raise InputError("daemon", f"start: is {self.state}; 'arm' comes first")
        started: Outcome = Future()
        started.add_done_callback(lambda _: wake())
        self._job = self._devices.submit(partial(self._jobs.run, self.run, started))
        self.armed = None
        self._go("running")
        return self._answers.of(started, lambda _: {"state": "running"})

    def stop(self, reason: End) -> None:
        """Ends any state towards idle. An arm on its way to the start pose is stopped where it is."""
        if self.state == "arming":
            if self._cancelled is None:
                self._cancelled = "was stopped before it was ready"
                self._holding = self._jobs.bench.guard.hold(self._cancelled)
        elif self.state == "armed":
            self._disarm()
        elif self.run is not None:
            self.run.stop(reason)

    def collect(self, clients: Container[str]) -> None:
        """Takes what the devices have done, and answers; an armed rig waits for its client, not for ever.

        clients: names of the liveliness tokens that are there.
        """
        held = self._holding is not None and self._holding.is_alive()
        if self._job is not None and self._job.done() and not held:
            job, self._job = self._job, None
            self._release()
            if self.state == "arming":
                self._armed_now(job)
            else:
                self._ended(job)
        self._answers.settle()
        if self.armed is not None and (why := self.armed.lapsed(clients)) is not None:
            self.why_disarmed = why
            self._disarm()

    def refuse_unless_idle(self, verb: str, why: str = "one run at a time") -> None:
        """InputError where something is armed or running."""
        if self.state == "idle":
            return
        doing = f"is {self.state}" if self.run is None else f"is {self.state} with {self.run.request.out}"
        raise InputError("daemon", f"{verb}: {doing}; {why}")

    def _go(self, state: str) -> None:
        self.state = state
        self._changed()

    def _go_idle(self, result: Table | None = None) -> None:
        """result  of the run that has ended, if one has."""
        self.run = self.armed = None
        self._go("idle")
        self._answers.settle_idle(result)

    def _armed_by(self, begin: Callable[[], Armed]) -> Armed:
        """On the thread of the devices. What they raise because arming was ended is that it was."""
        try:
            return begin()
        except DeviceFault:
            if self._cancelled is None:
                raise
            raise InputError("daemon", f"arm: {self._cancelled}") from None

    def _armed_answer(self, armed: Armed) -> Table:
        if self._cancelled is not None:
            raise InputError("daemon", f"arm: {self._cancelled}")
        return {"state": self.state, "file": str(armed.run.request.out)}

    def _armed_now(self, job: Outcome) -> None:
        if job.exception() is not None:
            self._go_idle()
            return
        self.armed = job.result()
        self.run = self.armed.run
        self._go("armed") if self._cancelled is None else self._disarm()

    def _disarm(self) -> None:
        """From armed to idle."""
        assert self.run is not None
        self.armed = None
        self._job = self._devices.submit(self.run.disarm)
        self._go("disarming")

    def _ended(self, job: Outcome) -> None:
        """After a run, or after disarming."""
        error = job.exception()
        if error is not None and not isinstance(error, InputError | DeviceFault):
            self.bug = error
        result = None
        if self.state == "running" and self.run is not None:
            self.last = result = self.run.result
        self._go_idle(result)

    def _release(self) -> None:
        """Ends what ``stop`` began while the rig was armed; what else tripped stays."""
        guard = self._jobs.bench.guard
        if self._holding is not None and guard.tripped == self._cancelled:
            guard.reset()
        self._holding = None
