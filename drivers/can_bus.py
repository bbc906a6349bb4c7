"""A CAN bus that several drivers of one rig share: one python-can bus, a mailbox a listener.

Whoever waits for a frame reads the bus himself, and puts into their mailboxes what comes for others: an answer that a
thread of the bus received would have to wait for one more thread to be scheduled. The bus's own thread receives while
no other thread does.
"""

from __future__ import annotations

import errno
import logging
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import Field, field_validator

from arm_io.table import Table
from drivers.rig_context import RigContext

MOST = 4096  # frames that a mailbox holds: unread frames are not kept for ever
# s since a driver last read: until then it will read again, and the bus's thread takes only the remaining frames
ATTENDED = 0.1
LEFT = 0.01  # s between such looks
TURN = 0.001  # s after which a thread that waits for another's reading checks its mailbox again
# s for which a frame may wait for room in the transmit queue: twice the 0.1 s that a queue of 90 full frames takes at
# 125 kbit/s. A queue that stays full longer is that of a bus on which no node acknowledges.
SEND = 0.2
RETRY = 0.001  # s between tries
OLDEST = 2.0  # s: a frame's stamp that is older was not given by this computer's clock
NETWORKED = ("udp_multicast",)  # python-can's interfaces that open a port to everybody
NO_BIT_RATE = ("virtual", "unix")
Frame = tuple[int, int, bytes]


class CanConfig(Table):
    """Where the bus is, in python-can's words: interface "socketcan" and channel "can0" for a Linux adapter.

    "unix" (a folder as channel, ``drivers.can_unix``) and "virtual" (within one process) carry the same frames without
    any wire. ValueError for an interface that listens to the network: CAN frames carry neither sender nor secret.
    """

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(gt=0)] = 1_000_000

    @field_validator("interface")
    @classmethod
    def _stays_here(cls, interface: str) -> str:
        if interface in NETWORKED:
            raise ValueError(
                f"{interface!r} listens to the whole network, unsecured; without a CAN adapter it must be 'unix', "
                "with a folder as 'channel', or 'socketcan' with a vcan channel"
            )
        return interface


def frame_bits(data_bytes: int) -> int:
    """Bits of a base-format data frame at its longest.

    47 with interframe space, the data, and a stuff bit after every fourth of the 34 + 8 n stuffable bits (ISO 11898-1).
    """
    return 47 + 8 * data_bytes + (34 + 8 * data_bytes - 1) // 4


class Mailbox:
    """The newest ``MOST`` frames with some identifiers, in the order of arrival: (host ns, identifier, data)."""

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus
        self._frames: deque[Frame] = deque(maxlen=MOST)

    def __len__(self) -> int:
        return len(self._frames)

    def put(self, at: int, identifier: int, data: bytes) -> None:
        self._frames.append((at, identifier, data))

    def take(self) -> list[Frame]:
        """All that have come, without waiting."""
        self._bus.read(0.0)
        return self.there()

    def wait(self, deadline: float) -> list[Frame]:
        """All that have come; where none has, waits for the first until ``deadline`` (s, time.monotonic)."""
        while not self._frames and (left := deadline - time.monotonic()) > 0:
            self._bus.read(left, self)
        return self.there()

    def there(self) -> list[Frame]:
        """All frames that another thread has read; the bus itself is not read. One thread takes from a mailbox."""
        return [self._frames.popleft() for _ in range(len(self._frames))]


class CanBus:
    """The bus. ``open`` and ``close`` count their callers; every method raises OSError where the bus is gone or off."""

    def __init__(self, config: CanConfig) -> None:
        self.config = config
        self._users = 0
        self._bus: Any = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._reading = threading.Lock()
        self._attended = -ATTENDED  # s, when a driver last read
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
        box = Mailbox(self)
        for identifier in identifiers:
            self._boxes.setdefault(identifier, []).append(box)
        return box

    def send(self, identifier: int, data: bytes) -> None:
        """Hands a frame to the bus; waits while its transmit queue is full. OSError where that lasts ``SEND`` s."""
        if self._error is not None or self._bus is None:
            raise OSError(self._error or "the bus is not open")
        message = self._can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
        try:
            with self._sending:
                self._send(message)
        except (self._can.CanError, OSError) as error:
            self._error = f"cannot send: {error}"
            raise OSError(self._error) from None

    def _send(self, message: Any) -> None:
        deadline = time.monotonic() + SEND
        while True:
            try:
                self._bus.send(message, timeout=max(deadline - time.monotonic(), 0.0))
                return
            except self._can.CanError as error:
                # python-can waits for the socket; a full queue of the interface shows as this error all the same.
                full = getattr(error, "error_code", None) == errno.ENOBUFS
                if not full or time.monotonic() > deadline:
                    raise
            time.sleep(RETRY)

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

        self._can: Any = can
        config = self.config
        try:
            self._bus = _python_can(config)
        except (can.CanError, OSError, ValueError) as error:
            self._bus = None
            raise OSError(f"no CAN bus {config.interface} {config.channel}: {error}") from None
        self._error = None
        for network in self._networks:
            network.bus = self._bus
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(self._stopping,), name="can", daemon=True)
        self._thread.start()

    def _stop(self) -> None:
        if self._thread is not None:
            self._stopping.set()
            self._thread.join()
        with self._reading:
            if self._bus is not None:
                self._bus.shutdown()
            self._bus = self._thread = None

    def _run(self, stopping: threading.Event) -> None:
        while not stopping.is_set():
            if self._error is not None or time.monotonic() - self._attended < ATTENDED:
                stopping.wait(LEFT)
                self._receive(0.0, 0.0)
            else:
                self._receive(ATTENDED, ATTENDED)

    def read(self, seconds: float, box: Mailbox | None = None) -> None:
        """Puts into the mailboxes what has come.

        ``seconds`` above 0: waits as long for a frame, or until another thread that reads may have brought one for
        ``box``.
        """
        self._attended = time.monotonic()
        if not self.is_open:
            time.sleep(min(seconds, TURN))
        self._receive(seconds, min(seconds, TURN), box)

    def _receive(self, seconds: float, turn: float, box: Mailbox | None = None) -> None:
        """The next frame within ``seconds`` s; for 0, all that have come.

        Waits ``turn`` s at most for another thread that reads, which may have put the awaited frame into ``box``.
        """
        if not self._reading.acquire(timeout=turn):
            return
        try:
            if box:
                return
            while self.is_open and (message := self._bus.recv(seconds)) is not None:
                self._deliver(message)
                if seconds:
                    break
        except (self._can.CanError, OSError) as error:
            self._error = f"cannot receive: {error}"
        finally:
            self._reading.release()

    def _deliver(self, message: Any) -> None:
        if message.is_error_frame:
            return
        identifier = message.arbitration_id
        if not message.is_extended_id and not message.is_remote_frame:
            at = _arrival(message.timestamp)
            for box in self._boxes.get(identifier, ()):
                box.put(at, identifier, bytes(message.data))
        for network in self._networks:
            network.notify(identifier, message.data, message.timestamp)


def _python_can(config: CanConfig) -> Any:
    """python-can's bus at this place."""
    import can

    if config.interface == "unix":  # found without an installed entry point, too
        from drivers.can_unix import UnixBus

        return UnixBus(config.channel)
    rate: dict[str, Any] = {} if config.interface in NO_BIT_RATE else {"bitrate": config.bitrate}
    return can.Bus(interface=config.interface, channel=config.channel, **rate)


def _arrival(stamp: float) -> int:
    """Host ns (monotonic) of a frame stamped with Unix time in s, as the kernel does; else the time of the call."""
    age = time.time_ns() - int(stamp * 1e9)
    now = time.monotonic_ns()  # read later, so that what holds this thread up here makes no frame older than it is
    return now - age if 0 <= age < OLDEST * 1e9 else now


def shared_bus(context: RigContext, config: CanConfig) -> CanBus:
    """The rig's one bus at this interface and channel."""
    return context.shared(("CAN", config.interface, config.channel), lambda: CanBus(config))
