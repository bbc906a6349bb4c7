"""US Digital AD4-B: one quadrature encoder on a 9600 baud serial port. Asked row by row: at most 192 rows/s, 24 bit."""

from __future__ import annotations

from arm_io import DeviceFault
from arm_io.table import NoSeconds, Seconds, Table
from drivers.blocks import one_row
from drivers.counting import ZeroAfterMotion, check_channel
from drivers.protocols import Block, CounterMode, HostClock, Identity, Plan, Quality
from drivers.reconnect import Reconnect, or_fault
from drivers.rig_context import RigContext
from drivers.serial_port import SerialPort, serial_ports
from drivers.us_digital_ad4b import protocol as ad4b

BYTE_SECONDS = 10 / ad4b.BAUD
ADVICE = "is the AD4-B plugged in and powered?"
SLOW = 2 * int(ad4b.WIRE_BYTES * BYTE_SECONDS * 1e9)  # ns for question and answer: the latch is not where it should be


class Config(Table):
    """An AD4-B in the rig file."""

    port: str
    timeout: Seconds = 0.05
    patience: NoSeconds = 5.0


class Ad4b:
    """The device (shapes: Polled, QuadratureCounter)."""

    width = (ad4b.WIDTH,)

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self._port = SerialPort(config.port, ad4b.BAUD)
        self._mode = CounterMode.X4
        self._added = 0
        self._stray = 0
        self._was_reset = False
        self._history = ZeroAfterMotion()
        self._reconnect = Reconnect(name, config.patience, ADVICE, self._port.close)

    def open(self) -> Identity:
        with or_fault(self.name, ADVICE, self._port.close):
            self._port.open()
            self._ping()
            self._initialise()
        return Identity(
            maker="US Digital",
            model="AD4-B",
            max_rate=ad4b.RATE,
            bits=ad4b.WIDTH,
            # The command takes one byte's time to arrive; the counter is latched then.
            latch_delay=BYTE_SECONDS,
            details={
                "port": self.config.port,
                "unconfirmed": "which checksum it confirms its mode with (its document does not say: sums and "
                "exclusive-or are taken)",
            },
        )

    def check(self) -> list[str]:
        if not self._port.is_open:
            return [f"{self.config.port} is not open: is the AD4-B plugged in?"]
        problems = []
        try:
            self._ping()
        except OSError as error:
            problems.append(f"{error}; is it powered, and is the baud rate {ad4b.BAUD}?")
        if self._stray:
            problems.append(f"{self._stray} bytes were not answers: noise on the line, or another program on the port")
        return problems

    def arm(self, plan: Plan) -> None:
        if not self._port.is_open:
            raise self._fault("is not open")
        if plan.rate > ad4b.RATE:
            raise self._fault(f"{plan.rate:g} rows/s requested, {ad4b.RATE:.0f} possible at {ad4b.BAUD} baud")
        self._was_reset = False
        self._reconnect.begin()

    def disarm(self) -> None: ...

    def close(self) -> None:
        self._port.close()

    def poll(self) -> Block:
        return self._reconnect.poll(self._clock, self._reopen, self._asked, (1, 0))

    def _asked(self, now: int) -> Block:
        count = self._position()
        if self._history.lost_power(count - (count >> 23 << 24), now):
            raise OSError("its count has fallen to 0: has it lost its power?")
        quality = Quality.DEVICE_RESET if self._was_reset else Quality.GOOD
        if self._clock.monotonic_ns() - now > SLOW:
            quality |= Quality.LATE
        latch = now + int(BYTE_SECONDS * 1e9)
        return one_row(latch, [(count + self._added) & 0xFFFFFF], quality=[int(quality)])

    def configure(self, channel: int, mode: CounterMode) -> None:
        check_channel(self.name, channel, len(self.width))
        self._mode = mode
        with or_fault(self.name, ADVICE):
            self._initialise()

    def preset(self, channel: int, value: int) -> None:
        """Reads the counter; the driver adds what is missing to ``value`` from now on.

        (The document does not say which way round the bytes of its preset register are, nor when they reach the
        counter.)
        """
        check_channel(self.name, channel, len(self.width))
        with or_fault(self.name, ADVICE):
            self._added = value - self._position()

    def index_enable(self, channel: int) -> None:
        raise self._fault("has no index line: preset the counter in a known pose")

    def index_seen(self, channel: int) -> int | None:
        return None

    def _position(self) -> int:
        count = ad4b.position(self._ask(ad4b.POSITION, ad4b.POSITION_BYTES))
        assert count is not None
        return count

    def _ping(self) -> None:
        if self._ask(ad4b.PING, 1) != ad4b.PONG:
            raise OSError("the device that answers is not an AD4-B")

    def _initialise(self) -> None:
        command = ad4b.initialise_command(self._mode)
        if not ad4b.confirms_initialise(command, self._ask(command, 1)):
            raise OSError("the AD4-B did not confirm its mode")
        self._history = ZeroAfterMotion()

    def _ask(self, command: bytes, length: int) -> bytes:
        """The answer, of exactly ``length`` bytes.

        Bytes that came before the question belong to an older one: they are thrown away. With more than ``length``
        bytes nothing is known about which are the right ones.
        """
        self._stray += self._port.discard()
        self._port.write(command)
        answer = bytearray()

        def take(data: bytes) -> bytes | None:
            answer.extend(data)
            return bytes(answer) if len(answer) >= length else None

        whole = self._port.wait_for(take, self.config.timeout)
        if whole is None:
            raise OSError(f"{len(answer)} of {length} bytes in {self.config.timeout:g} s")
        if len(whole) > length:
            self._stray += len(whole) - length
            raise OSError(f"{len(whole)} bytes where {length} were due")
        return whole

    def _reopen(self) -> None:
        """The line is drained, then pinged. A counter that stands at 0 again has lost its power."""
        self._port.open()
        self._port.wait_for(lambda data: None, 2 * ad4b.POSITION_BYTES * BYTE_SECONDS)
        self._ping()
        if self._position() == 0:
            self._was_reset = True
            self._initialise()

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> Ad4b:
    """The AD4-B at ``config.port``, closed."""
    return Ad4b(name, config, context.clock)


def find(config: Config) -> list[str]:
    """Where the AD4-B may be: the serial ports that there are."""
    return serial_ports()
