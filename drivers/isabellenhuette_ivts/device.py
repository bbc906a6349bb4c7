"""Isabellenhuette IVT-S: motor currents as numbers on a CAN bus, one sensor per motor.

It measures on its own clock, every ``period`` ms, 1 ms at the fastest, and cannot be triggered: a row takes the newest
result, at most a period old. Its channels are in A (not V): in the rig file, 1 A a "volt", 1 turn.
"""

from __future__ import annotations

import time
from typing import Annotated

from pydantic import Field

from arm_io import DeviceFault
from arm_io.table import NoSeconds, Seconds, Table
from drivers.blocks import one_row
from drivers.can_bus import CanBus, CanConfig, Mailbox, frame_bits, shared_bus
from drivers.isabellenhuette_ivts import protocol as ivt
from drivers.protocols import Block, HostClock, Identity, Plan, Quality
from drivers.reconnect import Reconnect, or_fault
from drivers.rig_context import RigContext

ADVICE = "is the bus terminated, are the sensors powered?"
TRIES = 3  # of a command
SEARCH = 0.3  # s
FIRST = 1.0  # s for the first results, on a busy machine too
Identifier = Annotated[int, Field(ge=0, le=0x7FF)]


class Sensor(Table):
    """CAN identifiers of one sensor.

    Sensors that share a bus need different ones (commands 1Fh and following set them).
    """

    command: Identifier = ivt.COMMAND_ID
    reply: Identifier = ivt.REPLY_ID
    result: Identifier = ivt.RESULT_ID


class Config(CanConfig):
    """Current sensors on one bus; analogue channels in this order.

    period         ms between results
    rated_current  A that the sensors are made for: the ends of their range
    stale_after    periods without a result after which the value is marked stale
    """

    sensors: tuple[Sensor, ...] = Field(default=(Sensor(),), min_length=1)
    period: Annotated[int, Field(ge=1, le=1000)] = 1
    rated_current: Annotated[float, Field(gt=0)] = 300.0
    stale_after: Annotated[float, Field(ge=1)] = 3.0
    timeout: Seconds = 0.1
    patience: NoSeconds = 5.0


class IvtSensors:
    """The device (shapes: Polled, AnalogInput)."""

    bits = 32

    def __init__(self, name: str, config: Config, bus: CanBus, clock: HostClock) -> None:
        self.name, self.config, self._bus, self._clock = name, config, bus, clock
        self.range_volts = ((-config.rated_current, config.rated_current),) * len(config.sensors)
        self._replies = [bus.listen([s.reply]) for s in config.sensors]
        self._boxes: list[Mailbox] = [bus.listen([s.result]) for s in config.sensors]
        self._results: list[ivt.Results] = []
        self._latest: list[tuple[int, ivt.Result | None]] = []
        self._made_for: tuple[int, ...] = ()  # A, as each sensor reports it; 0: not reported
        self._opened = False
        self._reconnect = Reconnect(name, config.patience, ADVICE)

    def open(self) -> Identity:
        self._results = [ivt.Results() for _ in self.config.sensors]
        with or_fault(self.name, f"is it powered, is the bit rate {self.config.bitrate}?", self.close):
            self._bus.open()
            self._opened = True
            serials, versions, self._made_for = zip(*map(self._introduced, range(len(self.config.sensors))))
            for k in range(len(self.config.sensors)):
                self._set_up(k)
        return Identity(
            maker="Isabellenhuette",
            model="IVT-S",
            serial=", ".join(serials),
            firmware=", ".join(dict.fromkeys(versions)),
            max_rate=1000.0 / self.config.period,
            latch_delay=0.0,
            bits=self.bits,
            details={"unit": "A", "bus": f"{self.config.interface} {self.config.channel}"},
        )

    def _set_up(self, k: int) -> None:
        """Stops sensor k, sets its current channel alone to cyclic, starts it."""
        self._command(k, ivt.stop_command())
        for channel in range(len(ivt.CHANNELS)):
            self._command(k, ivt.cyclic_command(channel, self.config.period if channel == 0 else 0))
        self._boxes[k].take()
        self._results[k].restart()
        self._command(k, ivt.run_command())

    def _introduced(self, k: int) -> tuple[str, str, int]:
        """Serial number, version and rated current (A) of sensor k, stopped; '' and 0 for what it does not report."""
        self._command(k, ivt.stop_command())
        asked = ivt.GET_SERIAL, ivt.GET_VERSION, ivt.GET_DEVICE
        serial, version, device = (self._command(k, bytes([what]), wanted=False) for what in asked)
        return ivt.serial_number(serial), ivt.version(version), ivt.rated_current(device) if device else 0

    def _command(self, k: int, command: bytes, *, wanted: bool = True) -> bytes:
        """Sends a command, waits for the reply, pauses; tries twice more, since every command may be repeated."""
        sensor, replies = self.config.sensors[k], self._replies[k]
        for _ in range(TRIES):
            replies.take()
            self._bus.send(sensor.command, command.ljust(8, b"\0"))
            deadline = time.monotonic() + self.config.timeout
            while time.monotonic() < deadline:
                for _, _, data in replies.wait(deadline):
                    if len(data) == ivt.REPLY_BYTES and data[0] == ivt.reply_to(command[0]):
                        self._clock.sleep(ivt.COMMAND_PAUSE)
                        return data
        if wanted:
            raise OSError(f"the sensor at {sensor.command:03X}h did not answer command {command[0]:02X}h")
        return b""

    def check(self) -> list[str]:
        if not self._bus.is_open:
            return [f"the bus {self.config.channel} is off or its adapter is gone: check wiring and both terminators"]
        problems = [
            f"the sensor at {sensor.result:03X}h is made for {amperes} A, not {self.config.rated_current:g}: "
            "correct 'rated_current'"
            for sensor, amperes in zip(self.config.sensors, self._made_for)
            if amperes not in (0, self.config.rated_current)
        ]
        deadline = time.monotonic() + 10 * self.config.period / 1000 + self.config.timeout
        for k, sensor in enumerate(self.config.sensors):
            frames = self._boxes[k].wait(deadline)
            results = [r for _, _, data in frames if (r := self._results[k].take(data)) is not None]
            if not results:
                problems.append(f"no results from {sensor.result:03X}h: is another program configuring the sensor?")
            elif results[-1].faulty:
                problems.append(f"the sensor at {sensor.result:03X}h reports a faulty measurement: see its error log")
            if self._results[k].lost:
                problems.append(
                    f"{self._results[k].lost} results of {sensor.result:03X}h were lost: the bus is too full"
                )
        return problems

    def arm(self, plan: Plan) -> None:
        if not self._bus.is_open:
            raise self._fault("the bus is not open")
        if plan.rate > 1000.0 / self.config.period:
            raise self._fault(
                f"{plan.rate:g} rows/s requested, a result comes every {self.config.period} ms: stale rows"
            )
        load = len(self.config.sensors) * frame_bits(ivt.RESULT_BYTES) * 1000 / self.config.period / self.config.bitrate
        if load > 0.9:
            raise self._fault(f"its results alone fill {load:.0%} of the bus: a longer period or fewer sensors")
        now = self._clock.monotonic_ns()
        self._latest = [(now, None)] * len(self.config.sensors)
        self._reconnect.begin()
        with or_fault(self.name, ADVICE):
            self._wait_for_first()

    def _wait_for_first(self) -> None:
        deadline = time.monotonic() + FIRST + 2 * self.config.period / 1000
        for k, box in enumerate(self._boxes):
            box.take()
            self._results[k].restart()
            self._latest[k] = (self._clock.monotonic_ns(), None)
            while self._latest[k][1] is None and time.monotonic() < deadline:
                for at, _, data in box.wait(deadline):
                    if (result := self._results[k].take(data)) is not None:
                        self._latest[k] = (at, result)
            if self._latest[k][1] is None:
                raise OSError(f"no result from the sensor at {self.config.sensors[k].result:03X}h")

    def disarm(self) -> None: ...

    def close(self) -> None:
        if self._opened:
            self._opened = False
            self._bus.close()

    def poll(self) -> Block:
        return self._reconnect.poll(self._clock, self._reopen, self._newest, (0, len(self.config.sensors)))

    def _newest(self, now: int) -> Block:
        """The newest result of each.

        OSError where the bus is off, or everybody silent, or a sensor does not take its settings.
        """
        self._bus.read(0.0)
        if self._heed_restarts(now):
            # setting up takes its time: what came meanwhile is newer than the row would be
            now = self._clock.monotonic_ns()
        values, flags = [], []
        for k, box in enumerate(self._boxes):
            lost = 0
            for at, _, data in box.there():
                if (result := self._results[k].take(data)) is not None:
                    lost += result.lost
                    self._latest[k] = (at, result)
            at, latest = self._latest[k]
            values.append(float("nan") if latest is None else latest.value)
            flags.append(int(self._quality(now - at, latest, lost)))
        if not self._bus.is_open or all(now - at > self.config.timeout * 1e9 for at, _ in self._latest):
            raise OSError("no sensor sends frames")
        return one_row(now, volts=values, quality=flags)

    def _heed_restarts(self, now: int) -> bool:
        """Sets a sensor up again that has restarted: it then has its factory settings, one value every 20 ms.

        Its values are missing meanwhile. True if there was such a sensor.
        """
        restarted = False
        for k, replies in enumerate(self._replies):
            if not any(data[:1] == bytes([ivt.ALIVE]) for _, _, data in replies.there()):
                continue
            self._latest[k] = (now, None)
            self._set_up(k)
            restarted = True
        return restarted

    def _quality(self, age: int, result: ivt.Result | None, lost: int) -> Quality:
        if result is None:
            return Quality.MISSING
        quality = Quality.GOOD
        if age > self.config.stale_after * self.config.period * 1e6:
            quality |= Quality.STALE
        if lost:
            quality |= Quality.LATE
        if result.saturated or result.faulty:
            quality |= Quality.SATURATED
        return quality

    def _reopen(self) -> None:
        if not self._bus.is_open:
            self._bus.reopen()
        for k in range(len(self.config.sensors)):
            self._set_up(k)
        self._wait_for_first()

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> IvtSensors:
    """The sensors of ``config.sensors``, closed."""
    return IvtSensors(name, config, shared_bus(context, config), context.clock)


def find(config: Config) -> list[str]:
    """Identifiers on which something sends 6-byte frames, as results are."""
    bus = CanBus(config)
    heard = bus.listen(range(0x800))
    try:
        bus.open()
        time.sleep(SEARCH)
        senders = {i for _, i, data in heard.take() if len(data) == ivt.RESULT_BYTES and data[0] == 0}
    except OSError:
        return []
    finally:
        bus.close()
    return [f"current results from {identifier:03X}h" for identifier in sorted(senders)]
