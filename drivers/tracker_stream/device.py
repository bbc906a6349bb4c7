"""An external tracker that sends its points as text over UDP or a serial line, and keeps them in a file of its own.

It cannot be triggered: after the start pulse it raises the trigger line once a sample, which is what the counters latch
on. Frame numbers count from 1 at the start, so that a lost datagram is a gap in the points and never a shift. Its
maximum rate and its memory are checked before arming.
"""

from __future__ import annotations

import contextlib
import socket
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from arm_io import DeviceFault, InputError, read_file
from arm_io.table import NoSeconds, Rate, Table
from drivers.blocks import empty
from drivers.loopback import is_loopback
from drivers.protocols import Block, EdgeSource, HostClock, Identity, Plan, Quality
from drivers.reconnect import Reconnect, in_words
from drivers.rig_context import RigContext
from drivers.serial_port import SerialPort
from drivers.tracker_stream.plausible import Numbering
from drivers.tracker_stream.protocol import Frames, Lines

METRES = {"m": 1.0, "mm": 1e-3}
LARGEST_FILE = 1 << 30  # bytes
TICK_HZ = 1e6  # block ticks: microseconds of the tracker's clock


class Config(Table):
    """A tracker in the rig file.

    host, port    UDP: where its datagrams arrive; a host other than loopback needs ``sender``, the one address listened
                  to
    serial, baud  or a serial port instead
    rate          Hz, as set on the tracker; max_rate and memory are its ceilings (memory: samples)
    file          where its own file lies after the run, if it writes one
    patience      s for which a lost serial port is retried before the run ends as a fault
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] | None = None
    sender: str | None = None
    serial: str | None = None
    baud: int = 115200
    unit: Literal["m", "mm"] = "m"
    rate: Rate = 1000.0
    max_rate: Rate = 1000.0
    memory: Annotated[int, Field(ge=1)] | None = None
    file: str | None = None
    patience: NoSeconds = 5.0

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.port is None) == (self.serial is None):
            raise ValueError("give either 'port' (UDP) or 'serial'")
        if self.rate > self.max_rate:
            raise ValueError(f"'rate' {self.rate:g} Hz is more than the tracker's 'max_rate', {self.max_rate:g} Hz")
        if self.port is not None and not is_loopback(self.host) and self.sender is None:
            raise ValueError(f"{self.host} is not loopback: 'sender' must name the tracker's address")
        return self


class TrackerStream:
    """The device (shapes: PositionTracker, Latched, Reconnecting)."""

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self.rate = config.rate
        self.memory = config.memory or np.iinfo(np.int64).max
        self._socket: socket.socket | None = None
        self._serial = SerialPort(config.serial or "", config.baud)
        self._lines = Lines()
        self._numbering = Numbering(self.rate, 0)
        self._last = 0  # newest frame
        self._sending: int | None = None  # newest frame of an earlier run that the tracker is still sending
        self._armed = False
        self._reconnect = Reconnect(name, config.patience, "is the cable in?")

    def open(self) -> Identity:
        self._lines, self._last, self._sending = Lines(), 0, None
        try:
            if self.config.port is not None:
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
                self._socket.bind((self.config.host, self.config.port))
                self._socket.setblocking(False)
            else:
                self._serial.open()
        except OSError as error:
            self.close()
            raise self._fault(f"{self._place}: {in_words(error)}; is another program listening there?") from None
        return Identity(
            maker="external",
            model="position tracker",
            max_rate=self.config.max_rate,
            memory=self.config.memory,
            details={"input": self._place, "tick_hz": f"{TICK_HZ:.0f}"},
        )

    @property
    def _place(self) -> str:
        return f"udp {self.config.host}:{self.config.port}" if self.config.port is not None else str(self.config.serial)

    def check(self) -> list[str]:
        if self._socket is None and not self._serial.is_open:
            return [f"{self._place} is not open"]
        problems = []
        if self._lines.refused:
            problems.append(f"{self._lines.refused} lines were not points: is the tracker set to frame,seconds,x,y,z?")
        if refused := self._numbering.refused:
            problems.append(f"{refused} points had a number that does not fit their time: check the line for noise")
        return problems

    def arm(self, plan: Plan) -> None:
        if self._socket is None and not self._serial.is_open:
            raise self._fault("is not open")
        if plan.rate > self.config.max_rate:
            raise self._fault(f"{plan.rate:g} samples/s asked, the tracker does at most {self.config.max_rate:g}")
        if plan.rows is not None and plan.rows > self.memory:
            seconds = self.memory / plan.rate
            raise self._fault(
                f"{plan.rows} samples requested, its memory has {self.memory}: record at most {seconds:g} s, or at a "
                "lower rate"
            )
        if plan.source == EdgeSource.TRACKER and plan.rate != self.rate:
            raise self._fault(f"is set to {self.rate:g} Hz, the rig expects {plan.rate:g}: set one of them")
        with contextlib.suppress(OSError):
            before = self._lines.feed(self._receive()).number
            if len(before):
                self._last = int(before[-1])
        # Its next line may still be of the earlier run, though none was waiting just now; half of one may have come.
        self._sending = self._last or self._sending
        self._lines.refused, self._last, self._armed = 0, 0, True
        self._numbering = Numbering(self.rate, self._clock.monotonic_ns())
        self._reconnect.begin()

    def disarm(self) -> None:
        self._armed = False

    def close(self) -> None:
        self._armed = False
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        self._serial.close()

    def read(self) -> Block:
        if not self._armed:
            raise self._fault("is not armed")
        if not self._reconnect.there(self._clock.monotonic_ns(), self._reopen):
            return empty(points=True)
        try:
            frames = self._lines.feed(self._receive())
        except OSError:
            self._reconnect.lose(self._clock.monotonic_ns())
            return empty(points=True)
        frames = self._of_this_run(frames)
        fresh = self._numbering.sift(frames, self._clock.monotonic_ns())
        frames = Frames(frames.number[fresh], frames.seconds[fresh], frames.points[fresh])
        if len(frames):
            self._last = int(frames.number[-1])
        return self._block(frames, self._clock.monotonic_ns())

    @property
    def seeking(self) -> bool:
        """True while a lost serial port is being retried."""
        return self._armed and self._reconnect.lost

    def _reopen(self) -> None:
        """The port once more; the frames' own numbers give the number lost meanwhile."""
        self._serial.open()
        self._lines.resume()

    def _of_this_run(self, frames: Frames) -> Frames:
        """The frames without those that still arrive from an earlier run: their numbers continue from before arming.

        The numbers of a new run begin at 1.
        """
        if self._sending is None or not len(frames):
            return frames
        again = np.flatnonzero((np.diff(frames.number, prepend=self._sending) < 0) | (frames.number == 1))
        if not len(again):
            self._sending = int(frames.number[-1])
            return Frames(frames.number[:0], frames.seconds[:0], frames.points[:0])
        self._sending = None
        first = again[0]
        return Frames(frames.number[first:], frames.seconds[first:], frames.points[first:])

    def recall(self) -> Block:
        """The tracker's own file. Raises DeviceFault where there is none, or a line of it is no point."""
        if self.config.file is None:
            raise self._fault("keeps no file: write 'file' in the rig file if it does")
        lines = Lines()
        try:
            frames = lines.feed(read_file(self.config.file, most=LARGEST_FILE) + b"\n")
        except InputError as error:
            raise self._fault(f"{error}; has the tracker written it?") from None
        if lines.refused or np.any(np.diff(frames.number) <= 0):
            raise self._fault(f"{self.config.file}: not every line is frame,seconds,x,y,z with rising frame numbers")
        return self._block(frames, 0)

    def _block(self, frames: Frames, host: int) -> Block:
        if not len(frames):
            return empty(points=True)
        broken = np.isnan(frames.points).any(axis=1)
        quality = np.where(broken, np.uint8(Quality.MISSING), np.uint8(0)).astype(np.uint8)
        return Block(
            number=frames.number - 1,
            host=np.full(len(frames), host, np.int64),
            tick=np.rint(frames.seconds * TICK_HZ).astype(np.int64),
            quality=quality[:, None],
            points=frames.points * METRES[self.config.unit],
        )

    def _receive(self) -> bytes:
        if self._socket is None:
            return self._serial.read()
        pieces = []
        with contextlib.suppress(BlockingIOError):
            while True:
                piece, (address, _) = self._socket.recvfrom(2048)
                if self.config.sender in (None, address):
                    pieces.append(piece if piece.endswith(b"\n") else piece + b"\n")
        return b"".join(pieces)

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> TrackerStream:
    """The tracker whose points arrive where ``config`` says, closed."""
    return TrackerStream(name, config, context.clock)
