"""CANopen encoders by CiA 406: every SYNC latches all of them at once; each answers with one frame.

The row's time is that of the SYNC as it left the host; how regular the SYNCs are is up to the host (a Python timer jitters by
up to a millisecond), but each is stamped. Ceiling: the bus; six encoders at 1 Mbit/s take 0.6 ms of it a row.
"""

from __future__ import annotations

import contextlib
import time
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from drivers import cia406_protocol as cia
from drivers.blocks import one_row
from drivers.can_bus import CanBus, CanConfig, frame_bits, shared_bus
from drivers.clock import SystemClock
from drivers.counting import check_channel
from drivers.reconnect import Reconnect, or_fault
from drivers.registry import World
from drivers.shapes import Block, CounterMode, HostClock, Identity, Plan, Quality
from inputs import DeviceFault

ADVICE = "is the bus terminated, are the encoders powered?"
SEARCH = 0.3  # s for all nodes to answer
Node = Annotated[int, Field(ge=1, le=127)]


class Config(CanConfig):
    """Encoders on one bus.

    nodes    their CANopen node numbers; counter channels in this order
    bits     of the position: the total measuring range 6002h is 2^bits
    timeout  s for which a row waits for the answers to its SYNC
    latest   s after which an answer that has not come never will
    """

    nodes: tuple[Node, ...] = Field(min_length=1)
    bits: Annotated[int, Field(ge=8, le=32)] = 32
    timeout: Annotated[float, Field(gt=0)] = 0.01
    latest: Annotated[float, Field(gt=0)] = 0.02
    patience: Annotated[float, Field(ge=0)] = 5.0

    @model_validator(mode="after")
    def _different(self) -> Self:
        if len(set(self.nodes)) != len(self.nodes):
            raise ValueError("'nodes': a node number is there twice")
        return self


class Cia406Encoders:
    """The device (shapes: Polled, QuadratureCounter)."""

    def __init__(self, name: str, config: Config, bus: CanBus, clock: HostClock) -> None:
        self.name, self.config, self._bus, self._clock = name, config, bus, clock
        self.width = (config.bits,) * len(config.nodes)
        self._answers = bus.listen([cia.TPDO1 + n for n in config.nodes])
        self._events = bus.listen([base + n for n in config.nodes for base in (cia.HEARTBEAT, cia.EMERGENCY)])
        self._sdo: dict[int, Any] = {}
        self._serials: dict[int, int] = {}  # by node
        self._rounds = cia.Rounds(config.nodes, config.latest)
        self._restarted: set[int] = set()
        self._emergencies: dict[int, bytes] = {}
        self._opened = False
        self._reconnect = Reconnect(name, config.patience, ADVICE)

    @property
    def max_rate(self) -> float:
        """Rows/s that fit on the bus with nothing else on it."""
        return self.config.bitrate / (frame_bits(0) + len(self.config.nodes) * frame_bits(4))

    def open(self) -> Identity:
        import canopen

        self._answers.take()
        self._events.take()
        with or_fault(self.name, "is the adapter plugged in and the interface up?"):
            self._bus.open()
        self._opened = True
        network = self._bus.network()
        with or_fault(self.name, ADVICE, self.close):
            for number in self.config.nodes:
                if number not in network:
                    network.add_node(canopen.RemoteNode(number, canopen.ObjectDictionary()))
                self._sdo[number] = network[number].sdo
                self._sdo[number].RESPONSE_TIMEOUT = 0.2
            self._serials.clear()
            serials = [f"{self._set_up(number):08X}" for number in self.config.nodes]
        return Identity(
            maker="CANopen",
            model=f"CiA 406, {len(serials)} encoders",
            serial=", ".join(serials),
            max_rate=self.max_rate,
            bits=self.config.bits,
            details={"bus": f"{self.config.interface} {self.config.channel}"},
        )

    def _set_up(self, number: int) -> int:
        """Makes node ``number`` answer every SYNC with its position; returns its serial number, which is to be the one it had."""
        profile = self._upload(number, cia.DEVICE_TYPE) & 0xFFFF
        if profile != cia.PROFILE:
            raise self._fault(f"node {number} is no encoder: its profile is {profile}, not 406")
        total, wanted = self._upload(number, cia.TOTAL_RANGE), 1 << self.config.bits
        if total != wanted & 0xFFFFFFFF and total != wanted - 1:
            raise self._fault(f"node {number} counts to {total} (6002h), not to 2^{self.config.bits}: correct 'bits'")
        serial = self._upload(number, cia.IDENTITY, 4)
        if self._serials.setdefault(number, serial) != serial:
            raise self._fault(
                f"node {number} is another encoder: serial number {serial:08X}, not {self._serials[number]:08X}"
            )
        self._bus.send(0x000, bytes([0x80, number]))  # NMT: pre-operational
        cob = cia.TPDO1 + number
        self._download(number, cia.TPDO1_PARAMETERS, 1, cob | cia.OFF, 4)
        self._download(number, cia.TPDO1_MAPPING, 0, 0, 1)
        self._download(number, cia.TPDO1_MAPPING, 1, cia.POSITION_MAPPED, 4)
        self._download(number, cia.TPDO1_MAPPING, 0, 1, 1)
        self._download(number, cia.TPDO1_PARAMETERS, 2, cia.EVERY_SYNC, 1)
        self._download(number, cia.CYCLIC_TIMER, 0, 0, 2)
        self._download(number, cia.TPDO1_PARAMETERS, 1, cob, 4)
        self._bus.send(0x000, bytes([0x01, number]))  # NMT: operational
        return serial

    def check(self) -> list[str]:
        if not self._bus.is_open:
            return [f"the bus {self.config.channel} is off or its adapter is gone: check wiring and both terminators"]
        problems = []
        for number in self.config.nodes:
            try:
                if alarms := self._upload(number, cia.ALARMS):
                    problems.append(f"node {number} raises alarm {alarms:04X} (6503h): see the encoder's manual")
            except OSError as error:
                problems.append(f"{error}; is it powered, is {self.config.bitrate} bit/s its bit rate?")
            if number in self._emergencies:
                problems.append(f"node {number} sent emergency {self._emergencies[number].hex()}")
        return problems

    def arm(self, plan: Plan) -> None:
        if plan.rate > self.max_rate:
            most = f"{self.max_rate:.0f} possible with {len(self.config.nodes)} encoders at {self.config.bitrate} bit/s"
            raise self._fault(f"{plan.rate:g} rows/s asked, {most}")
        if not self._bus.is_open:
            raise self._fault("the bus is not open")
        self._rounds = cia.Rounds(self.config.nodes, self.config.latest)
        self._restarted.clear()
        self._events.take()
        self._reconnect.begin()

    def disarm(self) -> None: ...

    def close(self) -> None:
        if self._opened:
            self._opened = False
            self._bus.close()

    def poll(self) -> Block:
        return self._reconnect.poll(self._clock, self._reopen, self._round, (len(self.config.nodes), 0))

    def _round(self, now: int) -> Block:
        """One SYNC and its answers; OSError where the bus is off."""
        answers = self._answers.take()
        self._heed_events()
        for at, identifier, data in answers:
            self._rounds.take(identifier - cia.TPDO1, data, at)
        if self._rounds.blocked(now):
            self._rounds.skip()
            return self._row(now)
        before = self._clock.monotonic_ns()
        self._rounds.begin(before)
        self._bus.send(cia.SYNC, b"")
        sent = (before + self._clock.monotonic_ns()) // 2
        deadline = time.monotonic() + self.config.timeout
        while not self._rounds.complete and time.monotonic() < deadline:
            for at, identifier, data in self._answers.wait(deadline):
                self._rounds.take(identifier - cia.TPDO1, data, at)
        self._rounds.end()
        return self._row(sent)

    def _row(self, host: int) -> Block:
        values, flags = [], []
        for number, node in self._rounds.nodes.items():
            quality = Quality.GOOD if node.value is not None else Quality.MISSING
            if node.doubtful:
                quality |= Quality.LATE
            if number in self._restarted:
                quality |= Quality.DEVICE_RESET
            values.append(node.value or 0)
            flags.append(int(quality))
        if all(node.value is None for node in self._rounds.nodes.values()) and not self._bus.is_open:
            raise OSError("the bus is off")
        return one_row(host, values, quality=flags)

    def _heed_events(self) -> None:
        """A node that boots has lost its settings: it is set up again, and its counts are marked from then on. DeviceFault where
        another encoder has taken its place."""
        for _, identifier, data in self._events.there():
            number = identifier & 0x7F
            if identifier & ~0x7F == cia.HEARTBEAT and data == cia.BOOT_UP:
                self._restarted.add(number)
                self._rounds.forget(number)
                with contextlib.suppress(OSError):
                    self._set_up(number)
            elif identifier & ~0x7F == cia.EMERGENCY and len(data) == 8 and data[:2] != b"\x00\x00":
                self._emergencies[number] = data

    def _reopen(self) -> None:
        if not self._bus.is_open:
            self._bus.reopen()
        for number in self.config.nodes:
            self._set_up(number)
        self._answers.take()

    def configure(self, channel: int, mode: CounterMode) -> None:
        check_channel(self.name, channel, len(self.width))
        if mode != CounterMode.X4:
            raise self._fault(
                f"has no quadrature lines: its position counts in its own units; {mode} means nothing here"
            )

    def preset(self, channel: int, value: int) -> None:
        """Writes 6003h: the encoder shows ``value`` where it now stands, and keeps that for good."""
        check_channel(self.name, channel, len(self.width))
        with or_fault(self.name, ADVICE):
            self._download(self.config.nodes[channel], cia.PRESET, 0, value & ((1 << self.config.bits) - 1), 4)

    def index_enable(self, channel: int) -> None:
        raise self._fault("is absolute: it has no index line")

    def index_seen(self, channel: int) -> int | None:
        return None

    def _upload(self, number: int, index: int, sub: int = 0) -> int:
        from can import CanError
        from canopen.sdo.exceptions import SdoError

        try:
            return int.from_bytes(self._sdo[number].upload(index, sub), "little")
        except (SdoError, CanError, OSError) as error:
            raise OSError(f"node {number}, object {index:04X}h: {error}") from None

    def _download(self, number: int, index: int, sub: int, value: int, size: int) -> None:
        from can import CanError
        from canopen.sdo.exceptions import SdoError

        try:
            self._sdo[number].download(index, sub, value.to_bytes(size, "little"))
        except (SdoError, CanError, OSError) as error:
            raise OSError(f"node {number}, object {index:04X}h: {error}") from None

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, world: World) -> Cia406Encoders:
    """The encoders of ``config.nodes``, closed."""
    return Cia406Encoders(name, config, shared_bus(world, config), world.get("host_clock", SystemClock()))


def find(config: Config) -> list[str]:
    """The nodes that answer on the bus when all are asked for their device type."""
    bus = CanBus(
        CanConfig(interface=config.interface, channel=config.channel, bitrate=config.bitrate, port=config.port)
    )
    answers = bus.listen([cia.SDO_REPLY + n for n in range(1, 128)])
    try:
        bus.open()
        for number in range(1, 128):
            bus.send(cia.SDO_REQUEST + number, cia.ASK_DEVICE_TYPE)
            if number % 16 == 0:
                time.sleep(0.005)
        time.sleep(SEARCH)
        profiles = {i - cia.SDO_REPLY: int.from_bytes(data[4:6], "little") for _, i, data in answers.take()}
    except OSError:
        return []
    finally:
        bus.close()
    return [f"node {n} with profile {p}{' (encoder)' * (p == cia.PROFILE)}" for n, p in sorted(profiles.items())]
