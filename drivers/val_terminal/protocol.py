"""The terminal of a Unimation VAL or VAL II controller, sans-IO: what an operator types, and what comes back.

A command is typed letter by letter, the controller echoes it; only when the echo is what was typed is it entered
(carriage return). Output lines follow, then the prompt, a dot at the start of a line: the command, its motion included,
is done. Source: Unimation, "User's Guide to VAL" (1980s editions): monitor commands SPEED, DRIVE, DO, WHERE, CALIB,
ABORT.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import Enum

CANCEL_LINE = b"\x15"  # Ctrl-U: forget what was typed
INTERRUPT = b"\x03"  # Ctrl-C: stop the command that runs
ENTER = b"\r"
PROMPT = "."
JOINTS = 6
_NUMBER = re.compile(r"[-+]?\d*\.?\d+")
_LONGEST_LINE = 400
LARGEST_ANGLE = 1e4
"""deg: 28 turns. No joint of an arm with VAL turns twice."""


def speed(percent: int) -> str:
    """Monitor speed, in per cent, on top of every other speed."""
    return f"SPEED {percent}"


def drive(joint: int, degrees: float, percent: int) -> str:
    """One joint by so many degrees. ValueError as ``move``."""
    return f"DRIVE {joint},{_typed(degrees)},{percent}"


def move(degrees: list[float]) -> str:
    """All joints together to a position (VAL II: VAL itself knows no #PPOINT). ValueError for an angle that is none."""
    return f"DO MOVE #PPOINT({','.join(map(_typed, degrees))})"


def _typed(degrees: float) -> str:
    """An angle as VAL reads it.

    ValueError for one that is not finite or beyond ``LARGEST_ANGLE``: what VAL makes of it is unknown.
    """
    if not abs(degrees) <= LARGEST_ANGLE:  # not NaN either
        raise ValueError(f"{degrees:g} degrees is not an angle of an arm")
    return f"{degrees:.3f}"


def program_speed(percent: int) -> str:
    """Speed of the next motion entered by DO."""
    return f"DO SPEED {percent}"


WHERE, ABORT, CALIBRATE = "WHERE", "ABORT", "CALIB"


@dataclass(frozen=True)
class Done:
    """A command and the lines that the controller answered, without echo and prompt."""

    command: str
    lines: tuple[str, ...]

    @property
    def complaint(self) -> str | None:
        """The controller's refusal.

        VAL puts its error messages between asterisks, older versions begin them with '?'.
        """
        return next((line for line in self.lines if line.startswith(("*", "?"))), None)


class State(Enum):
    """Of the command that is being typed."""

    IDLE = "idle"
    TYPED = "typed"  # waiting for the echo
    GARBLED = "echoed wrongly"  # the line is to be cancelled, and typed again once the controller has fallen silent
    RUNNING = "running"  # waiting for the prompt


class Session:
    """One terminal. ``type`` and ``feed`` return what is to be sent."""

    def __init__(self) -> None:
        self.state = State.IDLE
        self.retyped = 0  # commands whose echo was wrong
        self._command = ""
        self._buffer = ""
        self._lines: list[str] = []

    def type(self, command: str) -> bytes:
        """Begins a command; only one at a time."""
        if self.state != State.IDLE:
            raise RuntimeError(f"{self._command!r} is still {self.state.value}")
        self._command, self._buffer, self._lines = command, "", []
        self.state = State.TYPED
        return command.encode("ascii")

    def retype(self) -> bytes:
        """The echo was wrong or did not come, the line has been cancelled, the controller is silent: types it again."""
        self.retyped += 1
        self._buffer = ""
        self.state = State.TYPED
        return self._command.encode("ascii")

    def interrupt(self) -> bytes:
        """Stops whatever runs. The session is idle again; what the controller still says is passed over."""
        self.state = State.IDLE
        return INTERRUPT

    def feed(self, data: bytes) -> tuple[bytes, list[Done]]:
        """What came from the terminal -> what is to be sent, commands that are done."""
        self._buffer += data.decode("ascii", "replace")
        if self.state in (State.IDLE, State.GARBLED):
            self._buffer = ""
            return b"", []
        if self.state == State.TYPED:
            return self._echoed(), []
        return b"", self._answered()

    def _echoed(self) -> bytes:
        """ENTER once the whole echo is there."""
        # The prompt, and what was left of an older line, may stand before the echo.
        echo = self._buffer.rsplit("\n", 1)[-1].lstrip(PROMPT + "\r ")
        if echo == self._command:
            self.state, self._buffer = State.RUNNING, ""
            return ENTER
        if not self._command.startswith(echo) or len(self._buffer) > _LONGEST_LINE:
            self.state = State.GARBLED
        return b""

    def _answered(self) -> list[Done]:
        *lines, self._buffer = self._buffer.replace("\r", "").split("\n")
        self._lines += [line.strip() for line in lines]
        if self._buffer == PROMPT and self._lines:
            self.state, self._buffer = State.IDLE, ""
            return [Done(self._command, tuple(filter(None, self._lines)))]
        self._buffer = self._buffer[-_LONGEST_LINE:]
        return []


def where(lines: tuple[str, ...]) -> list[float] | None:
    """Joint angles (deg) from the answer to WHERE: a heading JT1 ... JT6, the position of the hand, the joint angles.

    None if the lines are not such an answer.
    """
    headings = [k for k, line in enumerate(lines) if "JT1" in line.upper()]
    if not headings:
        return None
    rows = [[float(n) for n in _NUMBER.findall(line)] for line in lines[headings[0] + 1 :]]
    rows = [row for row in rows if len(row) >= JOINTS]
    joints = rows[1][:JOINTS] if len(rows) >= 2 else [math.nan]
    return joints if all(abs(angle) <= LARGEST_ANGLE for angle in joints) else None
