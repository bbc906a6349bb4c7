"""A VAL II controller's terminal on a pty: echo, prompt, the commands that the tests need, an arm behind it."""

from __future__ import annotations

import re

import numpy as np

from drivers.val_terminal import Config
from drivers.val_terminal import protocol as val
from sim_backend.protocol.serving import OnTerminal, Terminal
from sim_backend.protocol.wires import Arm, Wires

_DRIVE = re.compile(r"DRIVE (\d),([-+.\d]+),(\d+)$")
_MOVE = re.compile(r"DO MOVE #PPOINT\(([-+.\d,]+)\)$")
_SPEED = re.compile(r"(DO )?SPEED (\d+)$")
READY_DEGREES = (0.0, 90.0, -90.0, 0.0, 0.0, 0.0)


class SimulatedVal(OnTerminal):
    """The controller. Faults for tests: ``pull_cable``/``plug_cable``, ``corrupt`` (bytes -> bytes on its way out)."""

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        assert wires.arm is not None, "a controller needs an arm"
        super().__init__(name, Terminal(name, config.port, config.baud / 10))
        self.config = config
        self.arm: Arm = wires.arm
        self.entered: list[str] = []
        self._line = ""
        self._moving = False
        self._commanded: list[float] | None = None  # where it was last sent; it may stand a little off
        self._monitor, self._program = 1.0, 1.0

    def _step(self, now: int) -> None:
        with self._lock:
            for letter in self._terminal.read():
                self._typed(bytes([letter]), now)
            if self._moving and not self.arm.moving(now):
                self._moving = False
                self._say("", now)
            self._terminal.flush(now)

    def _typed(self, letter: bytes, now: int) -> None:
        if letter == val.INTERRUPT:
            self.arm.halt(now)
            self._commanded = None
            if self._moving:
                self._moving = False
                self._say("*ABORTED*\r\n", now)
            self._line = ""
        elif letter == val.CANCEL_LINE:
            self._line = ""
            self._write("\r\n.", now)
        elif letter == val.ENTER:
            line, self._line = self._line.strip(), ""
            self._write("\r\n", now)
            self.entered.append(line)
            self._enter(line, now)
        else:
            self._line += letter.decode("ascii", "replace")
            self._write(letter.decode("ascii", "replace"), now)

    def _enter(self, line: str, now: int) -> None:
        if match := _SPEED.fullmatch(line):
            if not 1 <= int(match[2]) <= 300:
                return self._say("*Illegal value*\r\n", now)
            if match[1]:
                self._program = int(match[2]) / 100
            else:
                self._monitor = int(match[2]) / 100
            return self._say("", now)
        if match := _DRIVE.fullmatch(line):
            return self._drive(int(match[1]), float(match[2]), int(match[3]) / 100, now)
        if match := _MOVE.fullmatch(line):
            return self._go([float(d) for d in match[1].split(",")], self._program, now)
        if line == "DO READY":
            return self._go(list(READY_DEGREES), self._program, now)
        if line == val.WHERE:
            return self._say(self._where(now), now)
        if line in (val.ABORT, val.CALIBRATE, ""):
            if line == val.ABORT:
                self.arm.halt(now)
            return self._say("", now)
        return self._say("*Unknown command*\r\n", now)

    def _drive(self, joint: int, by: float, fraction: float, now: int) -> None:
        target = list(self._commanded or self._degrees(now))
        if not 1 <= joint <= len(target) or not 0 < fraction <= 1:
            return self._say("*Illegal value*\r\n", now)
        target[joint - 1] += by
        return self._go(target, fraction, now)

    def _go(self, degrees: list[float], fraction: float, now: int) -> None:
        """Begins a motion; the prompt comes when it is over."""
        joints = len(self.arm.position(now))
        sign, zero = np.array(self.config.sign[:joints]), np.array(self.config.zero[:joints])
        if len(degrees) < joints:
            return self._say("*Illegal value*\r\n", now)
        target = np.radians((np.array(degrees[:joints]) - zero) * sign)
        self.arm.move(target, min(1.0, fraction * self._monitor), now)
        self._moving, self._commanded = True, list(degrees)
        return None

    def _degrees(self, now: int) -> list[float]:
        q = self.arm.position(now)
        return [float(s * np.degrees(a) + z) for a, s, z in zip(q, self.config.sign, self.config.zero)]

    def _where(self, now: int) -> str:
        degrees = self._degrees(now) + [0.0] * (val.JOINTS - self.config.joints)
        joints = " ".join(f"{d:10.3f}" for d in degrees)
        hand = " ".join(f"{0.0:10.2f}" for _ in degrees)  # where the hand is, this controller does not work out
        return f"  X/JT1      Y/JT2      Z/JT3      O/JT4      A/JT5      T/JT6\r\n{hand}\r\n{joints}\r\n"

    def _say(self, text: str, now: int) -> None:
        self._write(text + "\r\n.", now)

    def _write(self, text: str, now: int) -> None:
        self._terminal.write(self.corrupt(text.encode("ascii", "replace")), now)


make = SimulatedVal
