"""US Digital QSB-D / QSB-S: one quadrature encoder on a USB serial port.

It cannot be triggered. ``reading`` "ask": each row is a question and an answer (the latch lies halfway, within half the
round trip); "stream": it sends its count as fast as 230400 baud takes it (1920 a second), and a row takes the newest
one, at most 0.5 ms old; one that was held up on its way by more than 2 ms is found by what else should have come by
then, and marked STALE.
"""

from __future__ import annotations

from typing import Literal

from arm_io import DeviceFault
from arm_io.table import NoSeconds, Seconds, Table
from drivers import stream_age
from drivers.blocks import one_row
from drivers.counting import ZeroAfterMotion, check_channel
from drivers.protocols import Block, CounterMode, EdgeSource, HostClock, Identity, Plan, Quality
from drivers.reconnect import Reconnect, or_fault
from drivers.rig_context import RigContext
from drivers.serial_port import SerialPort, serial_ports
from drivers.us_digital_qsb import protocol as qsb

ADVICE = "is the QSB plugged in?"
WIDTH = 32
ASK_BYTES = 4 + 12  # on the wire for one question and its answer
BACKLOG = 2048  # bytes read at once: the kernel gives 4096 at most, and more may lie behind them
HELD_UP = 2_000_000  # ns for a streamed count on its way, and for taking it, which is there already
BEHIND = 5_000_000_000  # ns for which a stream may be held up: then it is begun anew
TRIALS = 8  # requests, of which the quickest gives the round trip of the line
CLOCK_TOLERANCE = 0.01  # of the QSB's clock against the host's
UNSURE = 0.05  # s: when in a question and its answer the clock is read
SLOW = 10_000_000  # ns for question and answer, USB and all: beyond it the time of the latch is not known well


class Config(Table):
    """A QSB in the rig file.

    ``port``: best /dev/serial/by-id/usb-US_Digital..., which stays the same after a restart.
    """

    port: str
    reading: Literal["ask", "stream"] = "stream"
    timeout: Seconds = 0.05
    patience: NoSeconds = 5.0


class Qsb:
    """The device (shapes: Polled, QuadratureCounter)."""

    width = (WIDTH,)

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self._port = SerialPort(config.port, qsb.BAUD, dtr=True, rts=False)
        self._mode = CounterMode.X4
        self._added = 0
        self._count = self._taken = 0  # newest of the stream, and ns at which it came
        self._history = ZeroAfterMotion()
        self._age = stream_age.StreamAge(qsb.BAUD / 10)
        self._armed = self._was_reset = False
        self._reconnect = Reconnect(name, config.patience, ADVICE, self._port.close)

    def open(self) -> Identity:
        with or_fault(self.name, ADVICE, self._port.close):
            self._port.open()
            version = self._begin()
            self._write_mode()
            self._added = 0
        rate = qsb.STREAM_RATE if self.config.reading == "stream" else qsb.BAUD / 10 / ASK_BYTES
        return Identity(
            maker="US Digital",
            model="QSB",
            firmware=f"{version:08X}",
            max_rate=rate,
            latch_delay=12 * 10 / qsb.BAUD if self.config.reading == "stream" else 0.0,
            bits=WIDTH,
            details={"port": self.config.port, "reading": self.config.reading},
        )

    def _begin(self) -> int:
        """Makes the QSB stop streaming and answer barely; returns its version register."""
        self._replies = qsb.Replies()
        for _ in range(2):  # the first ends a stream, and is answered in whatever form was set before
            self._ask(qsb.write_command(qsb.OPTIONS, qsb.BARE), "w", qsb.OPTIONS)
        self._port.discard()
        self._replies = qsb.Replies(stamped=False)
        self._uptime, self._uptime_at = self._time(), self._clock.monotonic_ns()
        return self._ask(qsb.read_command(qsb.VERSION), "r", qsb.VERSION)

    def check(self) -> list[str]:
        if not self._port.is_open:
            return [f"{self.config.port} is not open: is the QSB plugged in?"]
        problems = []
        try:
            if self._armed and self.config.reading == "stream":
                return []
            quickest = min(self._round_trip() for _ in range(TRIALS))
            if quickest > SLOW:
                problems.append(
                    f"a request and its answer take {quickest * 1e-6:.0f} ms: an adapter buffers bytes, rows may be "
                    "that old; set its latency timer to 1 ms"
                )
            mode = self._ask(qsb.read_command(qsb.MDR0), "r", qsb.MDR0)
            if mode & 3 != qsb.FREE_RUNNING[self._mode]:
                problems.append(f"counts in mode {mode & 3}, not {self._mode}: it was reset; open the rig again")
        except OSError as error:
            problems.append(f"{error}; is it plugged in, is RTS low and DTR high?")
        if self._replies.garbage:
            problems.append(f"{self._replies.garbage} bytes were not replies: is the baud rate {qsb.BAUD}?")
        return problems

    def arm(self, plan: Plan) -> None:
        if plan.source == EdgeSource.TRACKER and self.config.reading == "ask" and plan.rate > qsb.BAUD / 10 / ASK_BYTES:
            raise self._fault(
                f"{plan.rate:g} rows/s requested, {qsb.BAUD / 10 / ASK_BYTES:.0f} possible by polling: stream"
            )
        if plan.rate > qsb.STREAM_RATE:
            raise self._fault(f"{plan.rate:g} rows/s requested, {qsb.STREAM_RATE:.0f} possible at {qsb.BAUD} baud")
        self._was_reset = False
        self._reconnect.begin()
        with or_fault(self.name, ADVICE):
            self._resume()
        self._armed = True

    def _resume(self) -> None:
        self._port.discard()
        if self.config.reading == "stream":
            self._ask(qsb.write_command(qsb.INTERVAL, 0, 4), "w", qsb.INTERVAL)
            self._port.write(qsb.stream_command(qsb.COUNT))
            self._value("s")
            self._age.restart()
            self._taken = self._clock.monotonic_ns()
            self._port.wait_for(self._learn, stream_age.LEARNING * 1e-9)
            self._kept_up = self._clock.monotonic_ns()

    def _learn(self, data: bytes) -> None:
        """The stream's first bytes: its pace, and a count for the first row."""
        now = self._clock.monotonic_ns()
        self._age.read(now, len(data))
        if counts := self._counted(data):
            self._count, self._taken = counts[-1], now

    def _counted(self, data: bytes) -> list[int]:
        return [r.value for r in self._replies.feed(data) if r.kind == "s" and r.register == qsb.COUNT]

    def disarm(self) -> None:
        self._armed = False
        if self._port.is_open:
            try:
                self._begin()
            except OSError:
                self._port.close()

    def close(self) -> None:
        if self._armed:
            self.disarm()
        self._port.close()

    def poll(self) -> Block:
        row = self._asked if self.config.reading == "ask" else self._newest
        return self._reconnect.poll(self._clock, self._reopen, row, (1, 0))

    def _asked(self, now: int) -> Block:
        """One row by question and answer.

        OSError where the answer is in the form, or the count, of a QSB that has just been switched on.
        """
        count = self._ask(qsb.read_command(qsb.COUNT), "r", qsb.COUNT)
        after = self._clock.monotonic_ns()
        signed = count - (count >> 31 << 32)
        if self._history.lost_power(signed, now) or self._replies.line_ends:
            raise OSError("it answers as after power-up")
        self._count, self._taken = signed, now
        return self._row((now + after) // 2, count, Quality.LATE if after - now > SLOW else Quality.GOOD)

    def _newest(self, now: int) -> Block:
        """The newest count that has arrived.

        It is STALE if it is older than the interval of the stream, or if its age is unknown.
        """
        data = piece = self._port.read()
        while len(piece) > BACKLOG:
            piece = self._port.read()
            data += piece
        delay = self._age.read(now, len(data))
        if counts := self._counted(data):
            self._count, self._taken = counts[-1], now
        if now - self._taken > self.config.timeout * 1e9:
            raise OSError("the stream has stopped")
        if delay <= HELD_UP:
            self._kept_up = now
        elif now - self._kept_up > BEHIND:
            raise OSError("the stream lags, or its rate has changed")
        old = now - self._taken > 2e9 / qsb.STREAM_RATE or delay > HELD_UP
        quality = Quality.STALE if old else Quality.GOOD
        # this process was: what was read is newer than ``now``, or older
        if self._clock.monotonic_ns() - now > HELD_UP:
            quality |= Quality.LATE
        return self._row(now, self._count, quality)

    def _row(self, host: int, count: int, quality: Quality) -> Block:
        if self._was_reset:
            quality |= Quality.DEVICE_RESET
        return one_row(host, [(count + self._added) & 0xFFFFFFFF], quality=[int(quality)])

    def _reopen(self) -> None:
        """A QSB whose clock stands earlier than it should, or that does not count, has lost its power."""
        self._port.open()
        passed = (self._clock.monotonic_ns() - self._uptime_at) * 1e-9 * qsb.TIME_HZ
        least = self._uptime + round(passed * (1 - CLOCK_TOLERANCE) - UNSURE * qsb.TIME_HZ)
        self._begin()
        earlier = (self._uptime - least) & 0xFFFFFFFF > 1 << 31
        if earlier or self._ask(qsb.read_command(qsb.MDR0), "r", qsb.MDR0) & 3 == 0:
            self._was_reset = True
            self._write_mode()
        self._resume()

    def configure(self, channel: int, mode: CounterMode) -> None:
        check_channel(self.name, channel, len(self.width))
        self._mode = mode
        with or_fault(self.name, ADVICE):
            self._write_mode()
        self._added = 0

    def _write_mode(self) -> None:
        self._ask(qsb.write_command(qsb.MDR0, qsb.FREE_RUNNING[self._mode], 2), "w", qsb.MDR0)
        self._ask(qsb.write_command(qsb.CLEAR, qsb.CLEAR_COUNTER), "w", qsb.CLEAR)
        self._count, self._history = 0, ZeroAfterMotion()

    def preset(self, channel: int, value: int) -> None:
        """Clears the counter; the driver adds ``value`` from now on."""
        check_channel(self.name, channel, len(self.width))
        with or_fault(self.name, ADVICE):
            self._write_mode()
        self._added = value

    def index_enable(self, channel: int) -> None:
        raise self._fault("the index line is not used by this driver: preset the counter in a known pose")

    def index_seen(self, channel: int) -> int | None:
        return None

    def _ask(self, command: bytes, kind: str, register: int) -> int:
        self._port.write(command)
        return self._value(kind, register)

    def _round_trip(self) -> int:
        """ns of a question and its answer."""
        before = self._clock.monotonic_ns()
        self._ask(qsb.read_command(qsb.VERSION), "r", qsb.VERSION)
        return self._clock.monotonic_ns() - before

    def _value(self, kind: str, register: int = qsb.COUNT) -> int:
        """Value of the next reply of this kind and register; others, of requests given up, are passed over."""

        def take(data: bytes) -> int | None:
            for reply in self._replies.feed(data):
                if reply.kind in "ex":
                    raise OSError(f"the QSB refused register {reply.register:02X}")
                if reply.kind == kind and reply.register == register:
                    return reply.value
            return None

        value = self._port.wait_for(take, self.config.timeout)
        if value is None:
            raise OSError(f"no answer in {self.config.timeout:g} s")
        return value

    def _time(self) -> int:
        return self._ask(qsb.read_command(qsb.TIME), "r", qsb.TIME)

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> Qsb:
    """The QSB at ``config.port``, closed."""
    return Qsb(name, config, context.clock)


def find(config: Config) -> list[str]:
    """Where the QSB may be: the serial ports that there are."""
    return serial_ports()
