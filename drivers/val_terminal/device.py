"""Unimation Puma under VAL or VAL II, through the serial port of its operator's terminal.

It types the commands of an operator: SPEED, DRIVE, WHERE; with VAL II also DO MOVE #PPOINT. Experiments with anything
else (trajectories, sines) are refused before anything moves: VAL cannot do them from its terminal.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from arm_io import DeviceFault
from arm_io.table import Seconds, Table
from drivers.protocols import HostClock, Identity, Plan
from drivers.reconnect import or_fault
from drivers.rig_context import RigContext
from drivers.serial_port import SerialPort, serial_ports
from drivers.val_terminal import protocol as val
from experiment import Experiment
from experiment.segments import Drive, Hold, Move, Repeat, Segment

ADVICE = "is the controller on, and nothing else on its terminal line?"
ARRIVED = 0.05  # deg: how near to the start pose the arm must stand
SETTLE = 8.0  # s that it may take for the last of it, under an integrating servo
SMALLEST = 5e-4  # deg: no move
PERCENT_TOLERANCE = 1e-6
SAME_SPEED = 0.02  # relative
QUIET = 0.05  # s without a letter: 50 letters' time at 9600 baud
MOST_DRAINED = 200
MOST_SEGMENTS = 100_000


class Config(Table):
    """A VAL controller in the rig file.

    dialect         "val2" knows joint-interpolated moves of all joints (DO MOVE #PPOINT); "val" only DRIVE
    sign, zero      VAL's joint angle (deg) = sign x the model's angle + zero, one entry per joint
    full_speed, full_acceleration  rad/s and rad/s2 of each joint at 100 %: an experiment that means something else by
                    "full speed" is refused
    approach_speed  per cent, on the way to the start pose
    answer_timeout  s until a command that moves nothing must be answered
    move_timeout    s until the longest single move must be over
    """

    port: str
    baud: int = 9600
    dialect: Literal["val", "val2"] = "val2"
    joints: Annotated[int, Field(ge=1, le=6)] = 6
    sign: tuple[Literal[-1, 1], ...] = (1, 1, 1, 1, 1, 1)
    zero: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    full_speed: tuple[Annotated[float, Field(gt=0)], ...] = (1.4312, 1.2915, 2.1293, 3.9794, 4.2062, 3.9794)
    full_acceleration: tuple[Annotated[float, Field(gt=0)], ...] = (8.0, 6.0, 12.0, 20.0, 25.0, 25.0)
    approach_speed: Annotated[int, Field(ge=1, le=100)] = 20
    answer_timeout: Seconds = 2.0
    move_timeout: Seconds = 60.0


@dataclass(frozen=True)
class Step:
    """Commands to type one after the other, or, with none, seconds to wait."""

    commands: tuple[str, ...] = ()
    seconds: float = 0.0


class ValTerminal:
    """The device (shape: ArmController)."""

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self.joints = config.joints
        self._port = SerialPort(config.port, config.baud)
        self._session = val.Session()
        self._steps: list[Step] = []
        self._queue: list[str] = []
        self._running = False
        self._deadline = self._wait_until = 0

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
        """Drives the arm slowly to the start pose and waits until it rests there; refuses what VAL cannot do."""
        if not isinstance(experiment, Experiment):
            raise self._fault(f"needs an Experiment, has {type(experiment).__name__}")
        if len(experiment.start) != self.joints:
            raise self._fault(f"the experiment is for {len(experiment.start)} joints, the arm has {self.joints}")
        if not np.allclose(experiment.full_speed, self.config.full_speed[: self.joints], rtol=SAME_SPEED):
            has, needed = list(experiment.full_speed), list(self.config.full_speed)
            raise self._fault(f"the experiment has full_speed {has} rad/s, this controller {needed}")
        try:
            self._steps = self._compile(experiment)
        except ValueError as error:
            raise self._fault(f"cannot do this experiment: {error}") from None
        with or_fault(self.name, ADVICE):
            self._command(val.speed(100))
            here, start = self._where(), self._degrees(experiment.start)
            for joint in range(self.joints):
                if not abs(start[joint] - here[joint]) <= SMALLEST:
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
        self._pending = list(self._steps)
        self._running = True
        self._wait_until = 0
        self._pump()
        # the first command is entered before this returns; ``finished`` enters later ones
        with or_fault(self.name, ADVICE):
            if self._session.state == val.State.TYPED:
                self._port.wait_for(self._entered, self.config.answer_timeout)

    def stop(self) -> None:
        self._running, self._pending, self._queue = False, [], []
        try:
            self._port.write(self._session.interrupt())
            self._silence()
            self._command(val.ABORT)
        except OSError as error:
            raise self._fault(f"{error}: the arm may still move, press the emergency stop") from None

    def finished(self) -> bool:
        """True once the last motion is over; types the next command where one is due."""
        if self._running:
            self._pump()
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

    # -- experiment -> commands ---------------------------------------------------------------------------------------

    def _compile(self, experiment: Experiment) -> list[Step]:
        if (count := _count(experiment.segment)) > MOST_SEGMENTS:
            raise self._fault(f"the experiment is {count} segments; at most {MOST_SEGMENTS} are typed, one by one")
        at = self._degrees(experiment.start)
        steps: list[Step] = []
        for segment in _flat(experiment.segment):
            match segment:
                case Hold():
                    steps.append(Step(seconds=segment.duration))
                case Drive():
                    joint = segment.joint - 1
                    sign = self.config.sign[joint]
                    if segment.to is not None:
                        target = sign * np.degrees(segment.to) + self.config.zero[joint]
                    else:
                        target = at[joint] + sign * np.degrees(segment.by or 0.0)
                    if not abs(target - at[joint]) <= SMALLEST:
                        steps.append(Step((val.drive(joint + 1, target - at[joint], self._percent(segment.speed)),)))
                    at[joint] = target
                case Move() if self.config.dialect == "val2":
                    at = self._degrees(segment.to)
                    steps.append(Step((val.program_speed(self._percent(segment.speed)), val.move(at))))
                case _:
                    can = "hold, drive and move" if self.config.dialect == "val2" else "hold and drive"
                    raise self._fault(f"cannot do a segment of type {segment.type!r} from its terminal; it can {can}")
        return steps

    def _percent(self, fraction: float) -> int:
        percent = round(fraction * 100) if 0 < fraction <= 1 else 0  # 0 for NaN
        if percent < 1 or not abs(percent - fraction * 100) <= PERCENT_TOLERANCE:
            raise self._fault(f"a speed of {fraction:g} is not a whole number of per cent, which VAL requires")
        return percent

    def _degrees(self, radians: list[float]) -> list[float]:
        degrees = [s * np.degrees(q) + z for s, q, z in zip(self.config.sign, radians, self.config.zero)]
        return [float(d) for d in degrees]

    # -- terminal -----------------------------------------------------------------------------------------------------

    def _where(self) -> list[float]:
        degrees = val.where(self._command(val.WHERE).lines)
        if degrees is None:
            raise OSError("the answer to WHERE shows no joints")
        return degrees

    def _command(self, command: str, timeout: float | None = None) -> val.Done:
        """Types a command and waits until it is done; OSError where it is not, or is refused.

        An echo that does not come in time is asked for again, once.
        """
        timeout = timeout or self.config.answer_timeout
        self._port.write(self._session.type(command))
        deadline = time.monotonic() + timeout
        for wait in (timeout / 2, timeout):
            done = self._port.wait_for(self._take, min(wait, deadline - time.monotonic()))
            if done is not None:
                return done
            if self._session.state == val.State.TYPED:
                self._retype()
        self._port.write(self._session.interrupt())
        raise OSError(f"no answer to {command!r} in {timeout:g} s")

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
                raise OSError(f"{result.command!r} was refused: {result.complaint}")
            return result
        return None

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def _count(segments: list[Segment]) -> int:
    """Segments with all repetitions, without writing them out."""
    return sum(_count(s.segment) * s.times if isinstance(s, Repeat) else 1 for s in segments)


def _flat(segments: list[Segment]) -> list[Segment]:
    flat: list[Segment] = []
    for segment in segments:
        flat += _flat(segment.segment) * segment.times if isinstance(segment, Repeat) else [segment]
    return flat


def make(name: str, config: Config, context: RigContext) -> ValTerminal:
    """The controller at ``config.port``, closed."""
    return ValTerminal(name, config, context.clock)


def find(config: Config) -> list[str]:
    """Where the controller may be: the serial ports that there are."""
    return serial_ports()
