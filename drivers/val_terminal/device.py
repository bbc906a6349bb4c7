"""Unimation Puma under VAL or VAL II, through the serial port of its operator's terminal.

It types the commands of an operator: SPEED, DRIVE, WHERE; with VAL II also DO MOVE #PPOINT. Experiments with anything
else (trajectories, sines) are refused before anything moves: VAL cannot do them from its terminal.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault, counted
from drivers.protocols import HostClock, Identity, Plan
from drivers.reconnect import or_fault
from drivers.rig_context import RigContext
from drivers.serial_port import SerialPort, serial_ports
from drivers.val_terminal import motion
from drivers.val_terminal import protocol as val
from drivers.val_terminal.config import Config
from experiment import Experiment

ADVICE = "is the controller on, and nothing else on its terminal line?"
ARRIVED = 0.05  # deg: how near to the start pose the arm must stand
SETTLE = 8.0  # s that it may take for the last of it, under an integrating servo
SAME_SPEED = 0.02  # relative
QUIET = 0.05  # s without a letter: 50 letters' time at 9600 baud
MOST_DRAINED = 200
NOTICE = 0.05  # s within which a wait for an answer notices that the arm is to stop
T = TypeVar("T")


class ValTerminal:
    """The device (shape: ArmController).

    ``stop`` may come from another thread than everything else: whoever waits for a move to end then gives up.
    """

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self.joints = config.joints
        self._port = SerialPort(config.port, config.baud)
        self._session = val.Session()
        self._steps: list[motion.Step] = []
        self._queue: list[str] = []
        self._running = False
        self._deadline = self._wait_until = 0
        self._line = threading.RLock()  # one conversation at a time
        self._halt = threading.Event()  # the conversation that goes on is to end, unless it is that of ``stop``
        self._halting = False

    def open(self) -> Identity:
        with or_fault(self.name, ADVICE, self._port.close):
            self._port.open()
            self._port.write(val.CANCEL_LINE)
            degrees = self._where()
        pose = " ".join(f"{d:.2f}" for d in degrees)
        return Identity(
            maker="Unimation",
            model="VAL II" if self.config.dialect == "val2" else "VAL",
            details={
                "port": self.config.port,
                "joints_deg": pose,
                "unconfirmed": f"the form of WHERE's answer: does the arm stand at {pose} deg?",
            },
        )

    def check(self) -> list[str]:
        if not self._port.is_open:
            return [f"{self.config.port} is not open"]
        if self._running:
            return []
        problems = []
        try:
            with self._line:
                self._where()
        except OSError as error:
            problems.append(f"{error}; is the controller on, is the baud rate {self.config.baud}?")
        if self._session.retyped:
            problems.append(f"{self._session.retyped} commands had a wrong echo: noise on the line, check its shield")
        return problems

    def arm(self, plan: Plan) -> None: ...

    def disarm(self) -> None: ...

    def close(self) -> None:
        if self._running:
            self.stop()
        self._port.close()

    # -- motion -------------------------------------------------------------------------------------------------------

    def load(self, experiment: object) -> None:
        """Drives the arm slowly to the start pose and waits until it rests there; refuses what VAL cannot do.

        DeviceFault, too, where ``stop`` ends this on another thread.
        """
        if not isinstance(experiment, Experiment):
            raise self._fault(f"needs an Experiment, has {type(experiment).__name__}")
        if len(experiment.start) != self.joints:
            raise self._fault(
                f"the experiment is for {counted(len(experiment.start), 'joint')}, the arm has {self.joints}"
            )
        if not np.allclose(experiment.full_speed, self.config.full_speed[: self.joints], rtol=SAME_SPEED):
            has, needed = list(experiment.full_speed), list(self.config.full_speed)
            raise self._fault(f"the experiment has full_speed {has} rad/s, this controller {needed}")
        try:
            self._steps = motion.steps(experiment, self.config)
        except ValueError as error:
            raise self._fault(f"cannot do this experiment: {error}") from None
        with self._line, or_fault(self.name, ADVICE):
            self._command(val.speed(100))
            here, start = self._where(), motion.degrees(experiment.start, self.config)
            for joint in range(self.joints):
                if not abs(start[joint] - here[joint]) <= motion.SMALLEST:
                    by = val.drive(joint + 1, start[joint] - here[joint], self.config.approach_speed)
                    self._command(by, self.config.move_timeout)
            here = self._settled(start)
        off = [k + 1 for k in range(self.joints) if not abs(start[k] - here[k]) <= ARRIVED]
        if off:
            raise self._fault(
                f"joint {off[0]} stands at {here[off[0] - 1]:.2f} deg, not at {start[off[0] - 1]:.2f}: CALIB it"
            )

    def _settled(self, start: list[float]) -> list[float]:
        """Joints (deg) once they stand at ``start``, or after ``SETTLE`` s: counters are preset to that pose."""
        deadline = time.monotonic() + SETTLE
        while True:
            here = self._where()
            away = max(abs(s - h) for s, h in zip(start, here))
            if away <= ARRIVED or time.monotonic() > deadline:
                return here
            self._clock.sleep(0.2)

    def start(self) -> None:
        if not self._steps:
            raise self._fault("has no experiment: load one before starting")
        with self._line:
            self._pending = list(self._steps)
            self._running = True
            self._wait_until = 0
            self._pump()
            # the first command is entered before this returns; ``finished`` enters later ones
            with or_fault(self.name, ADVICE):
                if self._session.state == val.State.TYPED:
                    self._wait(self._entered, self.config.answer_timeout)

    def stop(self) -> None:
        self._halt.set()
        try:
            self._port.write(val.INTERRUPT)  # before the line is free: the arm may be moving
            if not self._line.acquire(timeout=self.config.answer_timeout):
                raise OSError("the line is busy")
            self._halting = True
            try:
                self._running, self._pending, self._queue = False, [], []
                self._port.write(self._session.interrupt())
                self._silence()
                self._command(val.ABORT)
            finally:
                self._halting = False
                self._halt.clear()
                self._line.release()
        except OSError as error:
            raise self._fault(f"{error}: the arm may still move, press the emergency stop") from None

    def finished(self) -> bool:
        """True once the last motion is over; types the next command where one is due."""
        if self._running and self._line.acquire(blocking=False):
            try:
                self._pump()
            finally:
                self._line.release()
        return not self._running

    def demand(self, times: NDArray[np.float64]) -> NDArray[np.float64] | None:
        return None  # VAL does not report its setpoints

    def _pump(self) -> None:
        now = self._clock.monotonic_ns()
        try:
            self._take(self._port.read())
            if self._session.state != val.State.IDLE:
                if now > self._deadline:
                    raise OSError("a motion is not over in time")
                return
            if now < self._wait_until:
                return
            while not self._queue and self._pending:
                step = self._pending.pop(0)
                self._queue = list(step.commands)
                if step.seconds:
                    self._wait_until = now + int(step.seconds * 1e9)
                    return
            if not self._queue:
                self._running = False
                return
            self._deadline = now + int(self.config.move_timeout * 1e9)
            self._port.write(self._session.type(self._queue.pop(0)))
        except OSError as error:
            self._running = False
            raise self._fault(f"{error}; {ADVICE}") from None

    # -- terminal -----------------------------------------------------------------------------------------------------

    def _where(self) -> list[float]:
        degrees = val.where(self._command(val.WHERE).lines)
        if degrees is None:
            raise OSError("the answer to WHERE shows no joints")
        return degrees

    def _command(self, command: str, timeout: float | None = None) -> val.Done:
        """Types a command and waits until it is done; OSError if it is refused or does not end in time.

        If the echo does not come in time, the command is typed once more.
        """
        timeout = timeout or self.config.answer_timeout
        self._heed()
        self._port.write(self._session.type(command))
        deadline = time.monotonic() + timeout
        for wait in (timeout / 2, timeout):
            done = self._wait(self._take, min(wait, deadline - time.monotonic()))
            if done is not None:
                return done
            if self._session.state == val.State.TYPED:
                self._retype()
        self._port.write(self._session.interrupt())
        raise OSError(f"no answer to {command!r} in {timeout:g} s")

    def _wait(self, take: Callable[[bytes], T | None], seconds: float) -> T | None:
        """``SerialPort.wait_for`` that ends when the arm is to stop."""
        deadline = time.monotonic() + seconds
        while True:
            self._heed()
            found = self._port.wait_for(take, max(min(NOTICE, deadline - time.monotonic()), 0.0))
            if found is not None or time.monotonic() >= deadline:
                return found

    def _heed(self) -> None:
        """DeviceFault where another thread stops the arm."""
        if self._halt.is_set() and not self._halting:
            raise self._fault("was stopped")

    def _retype(self) -> None:
        self._port.write(val.CANCEL_LINE)
        self._silence()
        self._port.write(self._session.retype())

    def _silence(self) -> None:
        """Waits until the controller has nothing more to say."""
        for _ in range(MOST_DRAINED):
            if self._port.wait_for(lambda data: data, QUIET) is None:
                return

    def _entered(self, data: bytes) -> bool | None:
        self._take(data)
        return True if self._session.state != val.State.TYPED else None

    def _take(self, data: bytes) -> val.Done | None:
        answer, done = self._session.feed(data)
        if answer:
            self._port.write(answer)
        if self._session.state == val.State.GARBLED:
            self._retype()
        for result in done:
            if result.complaint is not None:
                self._heed()
                raise OSError(f"{result.command!r} was refused: {result.complaint}")
            return result
        return None

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> ValTerminal:
    """The controller at ``config.port``, closed."""
    return ValTerminal(name, config, context.clock)


def find(config: Config) -> list[str]:
    """Where the controller may be: the serial ports that there are."""
    return serial_ports()
