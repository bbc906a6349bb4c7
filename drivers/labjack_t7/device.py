"""LabJack T7: up to three quadrature encoders and the analogue inputs in one device-clocked scan, start line and DACs.

The scan clock is the trigger line on CIO3 (source ``tracker``) or the T7's own crystal (``timer``). Each scan carries
CORE_TIMER, the T7's time of the trigger. Ceiling: 100 000 samples/s over all slots (an AIN is one, a counter or
CORE_TIMER two), so 6.2 kHz for 8 AIN and 3 encoders. The converter is multiplexed: neighbouring channels are some 10 us
apart.

The T7 counts x4 only, from 0, 32 bit, and has no preset register: ``preset`` clears the counter and the driver adds the
value. Its own watchdog brings the outputs into their safe state when no command has come for ``watchdog`` seconds
(stream data does not feed it): that holds even when this computer is dead.
"""

from __future__ import annotations

import contextlib
import socket
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from arm_io import DeviceFault
from arm_io.table import NoSeconds, Seconds, Table
from drivers.blocks import join
from drivers.counting import check_channel
from drivers.labjack_t7 import protocol as t7
from drivers.labjack_t7 import setup as setup
from drivers.labjack_t7.core_timer import CoreTimer
from drivers.labjack_t7.link import T7Link
from drivers.protocols import Block, CounterMode, EdgeSource, HostClock, Identity, Plan, Quality
from drivers.reconnect import Reconnect, or_fault
from drivers.rig_context import RigContext

ADVICE = "is it powered, and is the cable in?"
CHANNEL_SKEW = 11e-6  # s between AINs of one scan at +-10 V, resolution index 0 (datasheet appendix A-1)
CLEAR_OFFSET = 100  # READ_A_AND_RESET lies 100 registers above READ_A


class Config(Table):
    """A T7 in the rig file.

    counters  even DIO line of each encoder's pair: 0 (FIO0/1), 2 (FIO2/3), 6 (FIO6/7); counter channels in this order
    inputs    AIN numbers; analogue channels in this order
    lines     digital outputs by name, as DIO numbers (FIO4 = 4, EIO0 = 8, CIO0 = 16)
    watchdog  s without a command after which the T7 itself lowers all lines and zeroes both DACs; 0: never
    patience  s for which a lost connection is retried before the run ends as a fault
    """

    host: str
    port: Annotated[int, Field(ge=0, le=65535)] = 502
    stream_port: Annotated[int, Field(ge=0, le=65535)] = 702
    counters: tuple[int, ...] = (0, 2, 6)
    inputs: tuple[Annotated[int, Field(ge=0, le=13)], ...] = (0, 1, 2, 3, 4, 5, 6, 7)
    lines: dict[str, Annotated[int, Field(ge=0, le=22)]] = Field(default={"start": 4})
    watchdog: Annotated[int, Field(ge=0)] = 2
    timeout: Seconds = 0.5
    patience: NoSeconds = 5.0

    @model_validator(mode="after")
    def _lines_free(self) -> Self:
        for line in self.counters:
            if line not in t7.QUADRATURE_PAIRS:
                raise ValueError(f"'counters': DIO{line} cannot count quadrature; {t7.QUADRATURE_PAIRS} can")
        taken = {line for even in self.counters for line in (even, even + 1)} | {t7.CLOCK_LINE}
        for name, line in self.lines.items():
            if line in taken:
                raise ValueError(f"'lines': {name} = {line} is an encoder's line or CIO3, the trigger")
        return self


class LabJackT7:
    """The device.

    Its protocols: Latched, Reconnecting, ClockReadings, TriggerInput, QuadratureCounter, AnalogInput, both outputs,
    OwnWatchdog.
    """

    numbered = True
    bits = 16
    output_range = ((0.0, 5.0), (0.0, 5.0))

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self.width = (32,) * len(config.counters)
        self.lines = tuple(config.lines)
        self.watchdog = float(config.watchdog)
        self._calibration = t7.InputCalibration()
        self.range_volts = (self._calibration.range_volts,) * len(config.inputs)
        self.scan = t7.ScanList(config.inputs, config.counters)
        self._link = T7Link(config.host, config.port, config.stream_port, config.timeout)
        self._preset = np.zeros(len(config.counters), np.int64)
        self._plan: Plan | None = None
        self._opened = False
        self._reconnect = Reconnect(name, config.patience, ADVICE)

    # -- life ---------------------------------------------------------------------------------------------------------

    def open(self) -> Identity:
        with or_fault(self.name, f"is it powered and on the network at {self.config.host}?", self._link.close):
            self._link.connect()
            identity = self._identify()
            self._link.write_uint(t7.STREAM_ENABLE, 0)
            setup.set_outputs_low(self._link, self.config.lines.values())
            setup.set_watchdog(self._link, self.config.lines.values(), self.config.watchdog)
            for line in self.config.counters:
                setup.start_counter(self._link, line)
        self._opened = True
        return identity

    def _identify(self) -> Identity:
        product = self._link.read_float(t7.PRODUCT_ID)
        if product != 7.0:
            raise self._fault(f"the device at {self.config.host} is product {product:g}, not a T7")
        calibration = setup.read_calibration(self._link)
        if calibration is None:
            raise self._fault("its calibration constants are invalid: restore them with LabJack's own program")
        self._calibration = calibration
        self.range_volts = (self._calibration.range_volts,) * len(self.config.inputs)
        self._serial = self._link.read_uint(t7.SERIAL)
        return Identity(
            maker="LabJack",
            model="T7",
            serial=str(self._serial),
            firmware=f"{self._link.read_float(t7.FIRMWARE):.4f}",
            max_rate=self.scan.fastest,
            latch_delay=0.0,
            channel_skew=CHANNEL_SKEW,
            bits=self.bits,
            details={
                "host": self.config.host,
                "tick_hz": f"{t7.CORE_TIMER_HZ:.0f}",
                "unconfirmed": "that a count of skipped scans includes the scan that marks them (as the U3's guide "
                "says); "
                "where it does not, the timer in every scan decides",
            },
        )

    def check(self) -> list[str]:
        if not self._link.connected:
            return [f"no connection to {self.config.host}: is it powered, and is the cable in?"]
        problems = []
        try:
            if self._link.read_float(t7.PRODUCT_ID) != 7.0:
                problems.append("it is no longer a T7: another device has its address")
            for line in self.config.counters:
                if not setup.counter_runs(self._link, line):
                    problems.append(f"the counter on DIO{line} is not configured: it was reset; open the rig again")
            if self._link.strays:
                problems.append(
                    f"{self._link.strays} replies belonged to no request: is another program talking to it?"
                )
        except OSError as error:
            problems.append(f"{error}; is the cable in?")
        return problems

    def close(self) -> None:
        if self._link.connected:
            self.disarm()
            self.safe()
        self._link.close()
        self._plan, self._opened = None, False

    # -- acquisition --------------------------------------------------------------------------------------------------

    def arm(self, plan: Plan) -> None:
        if plan.source not in (EdgeSource.TRACKER, EdgeSource.TIMER):
            raise self._fault(f"cannot be polled row by row: trigger source {plan.source} must be tracker or timer")
        if plan.rate > self.scan.fastest:
            most = f"{self.scan.fastest:.0f} rows/s with {self.scan.slots} slots per scan"
            raise self._fault(
                f"{plan.rate:g} rows/s requested, {most} possible: lower the rate or measure fewer channels"
            )
        self._plan, self._offset, self._resume = plan, 0, False
        self._rows: list[Block] = []
        self._edges: list[Block] = []
        self._number, self._first, self._last = -1, (0, 0), (0, 0)  # (number, tick) of the first and last row
        self._was_reset = False
        self._reconnect.begin()
        with or_fault(self.name, ADVICE):
            self._timer = CoreTimer(self._link, self._clock, plan)
            self._start_stream()

    def _start_stream(self) -> None:
        assert self._plan is not None
        rows = None if self._plan.rows is None else max(1, self._plan.rows - self._number - 1)
        setup.set_stream(self._link, self.scan, self._plan, rows)
        self._link.read_stream()
        self._timer.read_quickly()
        self._stream = t7.Stream(self.scan)
        self._link.write_uint(t7.STREAM_ENABLE, 1)

    def disarm(self) -> None:
        self._plan = None
        if self._link.connected:
            try:
                self._link.write_uint(t7.STREAM_ENABLE, 0)
            except OSError:
                self._link.close()

    def read(self) -> Block:
        self._pump()
        blocks, self._rows = self._rows, []
        return join(blocks, len(self.config.counters), len(self.config.inputs))

    def read_edges(self) -> Block:
        self._pump()
        blocks, self._edges = self._edges, []
        return join(blocks)

    def _pump(self) -> None:
        """Takes in what has arrived; tries again, with growing pauses, where the connection is lost."""
        if self._plan is None:
            raise self._fault("is not armed")
        now = self._clock.monotonic_ns()
        if not self._link.connected:
            self._reconnect.lose(now)
        if not self._reconnect.there(now, self._reopen):
            return
        try:
            self._timer.read_if_due(now)
            scans = self._stream.feed(self._link.read_stream())
        except OSError:
            self._link.close()
            return
        except t7.StreamStopped as stopped:
            raise self._fault(str(stopped)) from None
        if len(scans.number):
            self._keep(scans)

    def _keep(self, scans: t7.Scans) -> None:
        tick = self._timer.extend(scans.timer)
        host = self._timer.host(tick)
        if self._resume:
            self._offset, self._resume = self._number_at(int(tick[0])) - int(scans.number[0]), False
        number = scans.number + self._offset
        if self._number < 0:
            self._first = (int(number[0]), int(tick[0]))
        self._last = (int(number[-1]), int(tick[-1]))
        self._number = int(number[-1])
        quality = np.zeros((len(number), len(self.config.counters) + len(self.config.inputs)), np.uint8)
        if self._was_reset:
            quality[:, : len(self.config.counters)] |= np.uint8(Quality.DEVICE_RESET)
        saturated = (scans.codes == 0) | (scans.codes >= t7.SEPARATOR - 1)
        quality[:, len(self.config.counters) :] |= saturated * np.uint8(Quality.SATURATED)
        counts = (scans.counts + self._preset) & 0xFFFFFFFF
        self._rows.append(Block(number, host, tick, quality, counts, self._calibration.volts(scans.codes)))
        self._edges.append(Block(number, host, tick, np.zeros((len(number), 0), np.uint8)))

    def _reopen(self) -> None:
        """Connection and stream once more; numbers go on where the trigger line now is."""
        self._link.connect()
        try:
            if (serial := self._link.read_uint(t7.SERIAL)) != self._serial:
                raise OSError(f"another T7 answers: serial number {serial}, not {self._serial}")
            if not all(setup.counter_runs(self._link, line) for line in self.config.counters):
                self._begin_anew()
            self._start_stream()
        except OSError:
            self._link.close()
            raise
        self._resume = True

    def _begin_anew(self) -> None:
        """The T7 has lost its power: counters at 0, CORE_TIMER too. Raises OSError, also where its time is unsure."""
        self._was_reset = True
        self._timer.begin_anew()
        for line in self.config.counters:
            setup.start_counter(self._link, line)

    def _number_at(self, tick: int) -> int:
        """Number of the trigger at ``tick``, from the triggers before the loss and their mean interval."""
        if self._number < 0:
            return 0
        interval = self._timer.interval * 1e-9 * t7.CORE_TIMER_HZ
        if self._last[0] > self._first[0]:
            interval = (self._last[1] - self._first[1]) / (self._last[0] - self._first[0])
        return self._last[0] + max(1, round((tick - self._last[1]) / interval))

    def clock_readings(self) -> list[tuple[int, int]]:
        """(CORE_TIMER, host ns) of the readings since arming, four a second; late answers left out."""
        return self._timer.readings()

    @property
    def seeking(self) -> bool:
        """True while a lost connection is being retried."""
        return self._plan is not None and (self._reconnect.lost or self._resume)

    # -- counters and outputs -----------------------------------------------------------------------------------------

    def configure(self, channel: int, mode: CounterMode) -> None:
        check_channel(self.name, channel, len(self.width))
        if mode != CounterMode.X4:
            raise self._fault(f"counts x4 only; {mode} asked: write x4 for this encoder")
        with or_fault(self.name, ADVICE):
            setup.start_counter(self._link, self.config.counters[channel])
        self._preset[channel] = 0

    def preset(self, channel: int, value: int) -> None:
        check_channel(self.name, channel, len(self.width))
        line = self.config.counters[channel]
        with or_fault(self.name, ADVICE):
            self._link.read_uint(t7.EF_READ_A + CLEAR_OFFSET + 2 * line)
        self._preset[channel] = value

    def index_enable(self, channel: int) -> None:
        raise self._fault("the index line is not used by this driver: preset the counter in a known pose")

    def index_seen(self, channel: int) -> int | None:
        return None

    def write_line(self, line: str, high: bool) -> None:
        if line not in self.config.lines:
            raise self._fault(f"has no line {line!r}; it has {', '.join(self.lines)}")
        with or_fault(self.name, ADVICE):
            self._link.write_word(t7.DIO + self.config.lines[line], int(high))

    def write_volts(self, channel: int, volts: float) -> None:
        check_channel(self.name, channel, len(self.output_range))
        low, high = self.output_range[channel]
        if not low <= volts <= high:
            raise self._fault(f"DAC{channel}: {volts:g} V requested, {low:g} to {high:g} V possible")
        with or_fault(self.name, ADVICE):
            self._link.write_float(t7.DAC + 2 * channel, volts)

    def safe(self) -> None:
        """Lines low, DACs at 0 V: over a fresh connection where the other fails, else by the T7's own watchdog."""
        if self._opened:
            with contextlib.suppress(OSError):
                setup.force_outputs_low(self._link, self.config.lines.values())

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> LabJackT7:
    """The T7 at ``config.host``, closed."""
    return LabJackT7(name, config, context.clock)


def find(config: Config) -> list[str]:
    """Which of its two ports answer at the host."""
    answers = []
    for port, what in ((config.port, "commands"), (config.stream_port, "stream")):
        with contextlib.suppress(OSError), socket.create_connection((config.host, port), config.timeout):
            answers.append(f"{config.host}:{port} takes connections ({what})")
    return answers
