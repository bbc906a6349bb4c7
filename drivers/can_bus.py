"""A CAN bus that several drivers of one rig share: one python-can bus and one receiving thread, a mailbox a listener."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from drivers.registry import World


class CanConfig(BaseModel):
    """Where the bus is, in python-can's words: interface "socketcan" and channel "can0" for a Linux adapter.

    udp_multicast (a group address as channel) and virtual carry the same frames without any wire.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(gt=0)] = 1_000_000
    port: int | None = None  # udp_multicast only


def frame_bits(data_bytes: int) -> int:
    """Bits of a base-format data frame at its longest: 47 with interframe space, the data, and a stuff bit after every fourth
    of the 34 + 8 n stuffable bits (ISO 11898-1)."""
    return 47 + 8 * data_bytes + (34 + 8 * data_bytes - 1) // 4


class Mailbox:
    """Frames with some identifiers, in the order of arrival: (host ns, identifier, data)."""

    def __init__(self) -> None:
        self._frames: list[tuple[int, int, bytes]] = []
        self._arrived = threading.Condition()

    def put(self, at: int, identifier: int, data: bytes) -> None:
        with self._arrived:
            self._frames.append((at, identifier, data))
            self._arrived.notify_all()

    def take(self) -> list[tuple[int, int, bytes]]:
        """All that have come, without waiting."""
        with self._arrived:
            frames, self._frames = self._frames, []
        return frames

    def wait(self, deadline: float) -> list[tuple[int, int, bytes]]:
        """All that have come; where none has, waits for the first until ``deadline`` (s, time.monotonic)."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._frames), max(0.0, deadline - time.monotonic()))
            frames, self._frames = self._frames, []
        return frames


class CanBus:
    """The bus. ``open`` and ``close`` count their callers; every method raises OSError where the bus is gone or off."""

    def __init__(self, config: CanConfig) -> None:
        self.config = config
        self._users = 0
        self._bus: Any = None
        self._notifier: Any = None
        self._boxes: dict[int, list[Mailbox]] = {}
        self._networks: list[Any] = []
        self._error: str | None = None
        self._sending = threading.Lock()

    @property
    def is_open(self) -> bool:
        return self._bus is not None and self._error is None

    def open(self) -> None:
        self._users += 1
        if not self.is_open:
            try:
                self._start()
            except OSError:
                self._users -= 1
                raise

    def close(self) -> None:
        self._users = max(0, self._users - 1)
        if self._users == 0:
            self._stop()

    def reopen(self) -> None:
        """After a bus-off or a pulled adapter: the bus from scratch, the mailboxes kept."""
        self._stop()
        self._start()

    def listen(self, identifiers: Iterable[int]) -> Mailbox:
        """A mailbox for frames with these identifiers."""
        box = Mailbox()
        for identifier in identifiers:
            self._boxes.setdefault(identifier, []).append(box)
        return box

    def send(self, identifier: int, data: bytes) -> None:
        import can

        if self._error is not None or self._bus is None:
            raise OSError(self._error or "the bus is not open")
        try:
            with self._sending:
                self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        except (can.CanError, OSError) as error:
            self._error = f"cannot send: {error}"
            raise OSError(self._error) from None

    def network(self) -> Any:
        """A canopen.Network on this bus, for SDO and NMT; kept over ``reopen``."""
        import canopen

        if not self._networks:
            log = logging.getLogger("canopen")  # what it would print, drivers raise
            log.addHandler(logging.NullHandler())
            log.propagate = False
            self._networks.append(canopen.Network(self._bus))
        return self._networks[0]

    def _start(self) -> None:
        import can

        config = self.config
        extra: dict[str, Any] = {} if config.port is None else {"port": config.port}
        if config.interface not in ("virtual", "udp_multicast"):
            extra["bitrate"] = config.bitrate
        try:
            self._bus = can.Bus(interface=config.interface, channel=config.channel, **extra)
        except (can.CanError, OSError, ValueError) as error:
            self._bus = None
            raise OSError(f"no CAN bus {config.interface} {config.channel}: {error}") from None
        self._error = None
        for network in self._networks:
            network.bus = self._bus
        self._notifier = can.Notifier(self._bus, [_Receiver(self)], timeout=0.1)

    def _stop(self) -> None:
        if self._notifier is not None:
            self._notifier.stop(1.0)
        if self._bus is not None:
            self._bus.shutdown()
        self._bus = self._notifier = None

    def received(self, message: Any) -> None:
        """From the receiving thread."""
        at = time.monotonic_ns()
        if message.is_error_frame:
            return
        if not message.is_extended_id and not message.is_remote_frame:
            for box in self._boxes.get(message.arbitration_id, ()):
                box.put(at, message.arbitration_id, bytes(message.data))
        for network in self._networks:
            network.notify(message.arbitration_id, message.data, message.timestamp)

    def failed(self, error: BaseException) -> None:
        """From the receiving thread, which ends."""
        self._error = f"cannot receive: {error}"


class _Receiver:
    """What python-can wants of a listener."""

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus

    def __call__(self, message: Any) -> None:
        self._bus.received(message)

    def on_error(self, error: BaseException) -> None:
        self._bus.failed(error)

    def stop(self) -> None: ...


def shared_bus(world: World, config: CanConfig) -> CanBus:
    """The rig's one bus at this interface and channel."""
    buses: dict[tuple[str, str, int | None], CanBus] = world.setdefault("can", {})
    key = (config.interface, config.channel, config.port)
    return buses.setdefault(key, CanBus(config))
