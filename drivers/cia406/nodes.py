"""CANopen encoders (CiA 406) on a bus, set up to answer every SYNC with their position; whoever sends the SYNCs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from arm_io import DeviceFault
from drivers.can_bus import CanBus, CanConfig, frame_bits
from drivers.cia406 import protocol as cia
from drivers.counting import check_channel
from drivers.protocols import CounterMode, HostClock, Identity, Plan
from drivers.reconnect import Reconnect, or_fault

ADVICE = "is the bus terminated, are the encoders powered?"
SEEK_EVERY = 1_000_000_000  # ns
SEEK_AGAIN = 200_000_000  # ns after a node that could not be set up
Node = Annotated[int, Field(ge=1, le=127)]


class Config(CanConfig):
    """Encoders on one bus.

    nodes    their CANopen node numbers; counter channels in this order
    bits     of the position: the total measuring range 6002h is 2^bits
    sync     who sends the SYNCs: "host", this computer, one for every row that it asks for; the number of a node that
             can (objects 1005h, 1006h), at the rig's rate; "bus", a device that sends them anyway, such as a PLC
    timeout  s for which a row waits for the answers to its SYNC
    latest   s after which an answer that has not come never will
    """

    nodes: tuple[Node, ...] = Field(min_length=1)
    bits: Annotated[int, Field(ge=8, le=32)] = 32
    sync: Literal["host", "bus"] | Node = "host"
    timeout: Annotated[float, Field(gt=0)] = 0.01
    latest: Annotated[float, Field(gt=0)] = 0.02
    patience: Annotated[float, Field(ge=0)] = 5.0

    @model_validator(mode="after")
    def _different(self) -> Self:
        if len(set(self.nodes)) != len(self.nodes):
            raise ValueError("'nodes': a node number is there twice")
        return self


class EncoderNodes:
    """All of a driver but its rows (shapes: QuadratureCounter)."""

    def __init__(self, name: str, config: Config, bus: CanBus, clock: HostClock) -> None:
        self.name, self.config, self._bus, self._clock = name, config, bus, clock
        self.width = (config.bits,) * len(config.nodes)
        self._addressed = set(config.nodes) | ({config.sync} if isinstance(config.sync, int) else set())
        announcements = (cia.HEARTBEAT, cia.EMERGENCY, cia.SDO_REPLY)
        self._events = bus.listen([base + n for n in self._addressed for base in announcements])
        self._asked = 0  # ns: when silent nodes were last asked what ails them
        self._sdo: dict[int, Any] = {}
        self._serials: dict[int, int] = {}  # by node
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

        with or_fault(self.name, "is the adapter plugged in and the interface up?"):
            self._bus.open()
        self._opened = True
        network = self._bus.network()
        with or_fault(self.name, ADVICE, self.close):
            for number in self._addressed:
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
            details={"bus": f"{self.config.interface} {self.config.channel}", "sync": str(self.config.sync)},
        )

    def _set_up(self, number: int) -> int:
        """Makes node ``number`` answer every SYNC with its position.

        Returns its serial number, which is to be the one it had.
        """
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
            raise self._fault(f"{plan.rate:g} rows/s requested, {most}")
        if not self._bus.is_open:
            raise self._fault("the bus is not open")
        self._restarted.clear()
        self._events.take()
        self._reconnect.begin()

    def close(self) -> None:
        if self._opened:
            self._opened = False
            self._bus.close()

    def _seek(self, silent: Iterable[int], now: int) -> None:
        """Asks nodes that give no positions for their settings from time to time, without waiting for the answers.

        ``_heed_events`` takes the answers.
        """
        if now - self._asked > SEEK_EVERY:
            self._asked = now
            for number in silent:
                with contextlib.suppress(OSError):  # who reads next finds the bus off
                    self._bus.send(cia.SDO_REQUEST + number, cia.ASK_WHEN_SENT)

    def _heed_events(self) -> list[int]:
        """A node that boots, or whose settings are not ours any more, has restarted.

        It is set up again, and its counts are marked from then on. DeviceFault where another encoder has taken its
        place. Returns the nodes that did restart.
        """
        booted: list[int] = []
        for _, identifier, data in self._events.there():
            number = identifier & 0x7F
            boots = identifier & ~0x7F == cia.HEARTBEAT and data == cia.BOOT_UP
            foreign = identifier & ~0x7F == cia.SDO_REPLY and data[:4] == cia.WHEN_SENT and data[4] != cia.EVERY_SYNC
            if (boots or foreign) and number not in booted:
                booted.append(number)
                if number in self.config.nodes:
                    self._restarted.add(number)
                    try:
                        self._set_up(number)
                    except OSError:  # still busy with its restart, or off the bus once more
                        self._asked = self._clock.monotonic_ns() - SEEK_EVERY + SEEK_AGAIN
            elif identifier & ~0x7F == cia.EMERGENCY and len(data) == 8 and data[:2] != b"\x00\x00":
                self._emergencies[number] = data
        return booted

    def _reopen(self) -> None:
        """Opens the bus and every node again.

        A node whose settings differ from those written has restarted, even if its boot-up message was not received.
        """
        if not self._bus.is_open:
            self._bus.reopen()
        for number in self.config.nodes:
            if self._upload(number, cia.TPDO1_PARAMETERS, 2) != cia.EVERY_SYNC:
                self._restarted.add(number)
            self._set_up(number)
        self._events.take()

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
