"""A CAN bus that stays on this machine: python-can over Unix sockets, for simulators and rigs without a CAN adapter.

The channel is a folder of this user's alone (mode 0700). Whoever is on the bus listens there on a socket of its own
(SOCK_SEQPACKET) and connects to every other one to send: there is no hub whose end would be the bus's. A link is one
way, its frames stay whole and in order. As on a CAN adapter, a receiver that does not read loses frames (some hundred
fit into its socket) and delays no other node. A socket that a killed process left behind is removed by the next one to
send. Frames are stamped when they are sent.

python-can finds it as interface "unix" (entry point ``can.interface``): ``python -m can.viewer -i unix -c
/tmp/armscope/can``.
"""

from __future__ import annotations

import contextlib
import os
import re
import selectors
import socket
import stat
import struct
import time
import uuid
from collections import deque
from pathlib import Path
from typing import Any

import can

_HEAD = struct.Struct("<dI")  # Unix time of sending, s; identifier with SocketCAN's flags in its upper bits
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
IDENTIFIER = 0x1FFFFFFF
MOST_BYTES = 8
WAITING = 64  # senders that may have connected since the last look
TICK = 50_000_000  # ns, more than a file system's clock stands still
_NAME = re.compile(r"\d+-[0-9a-f]{8}")


class UnixBus(can.BusABC):
    """``channel``: the folder. A frame reaches everybody on the bus but its sender."""

    def __init__(self, channel: Any, **options: Any) -> None:
        self._folder = Path(channel)
        self._own = self._folder / f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._selector = selectors.DefaultSelector()
        self._to: dict[str, socket.socket] = {}
        self._seen = -1  # ns: when the folder had last changed
        self._came: deque[can.Message] = deque()
        self._can_protocol = can.CanProtocol.CAN_20
        self.channel_info = f"unix {channel}"
        try:
            _make_private(self._folder)
            # Under its name only when it listens: a socket that refuses a connection is taken for a dead one.
            early = self._folder / f".{self._own.name}"
            self._listening.bind(str(early))
            self._listening.listen(WAITING)
            early.rename(self._own)
        except OSError as error:
            self._listening.close()
            self._selector.close()
            self._is_shutdown = True
            raise can.CanInitializationError(f"{self._own}: {error.strerror or error}") from None
        self._listening.setblocking(False)
        self._selector.register(self._listening, selectors.EVENT_READ)
        super().__init__(channel, **options)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hands the frame to everybody who is on the bus now, without waiting: ``timeout`` is not needed."""
        if msg.is_fd or len(msg.data) > MOST_BYTES:
            raise can.CanOperationError("CAN FD frames are not for this bus")
        flags = EXTENDED * msg.is_extended_id | REMOTE * msg.is_remote_frame | ERROR * msg.is_error_frame
        frame = _HEAD.pack(time.time(), msg.arbitration_id | flags) + bytes(msg.data)
        self._look_round()
        for name, link in list(self._to.items()):
            try:
                link.send(frame)
            except BlockingIOError:
                pass
            except OSError:
                self._forget(name)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._came:
            remaining = None if deadline is None else max(0.0, deadline - time.monotonic())
            self._take(remaining)
            if not self._came and remaining == 0.0:
                return None, False
        return self._came.popleft(), False

    def shutdown(self) -> None:
        """Leaves the bus."""
        if self._is_shutdown:
            return
        super().shutdown()
        self._own.unlink(missing_ok=True)
        for key in list(self._selector.get_map().values()):
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()
        for name in list(self._to):
            self._forget(name)

    def _take(self, seconds: float | None) -> None:
        """Waits ``seconds`` for frames; takes one of each sender that has some."""
        for key, _ in self._selector.select(seconds):
            link = key.fileobj
            assert isinstance(link, socket.socket)
            if link is self._listening:
                with contextlib.suppress(BlockingIOError):
                    link, _ = link.accept()
                    link.setblocking(False)
                    self._selector.register(link, selectors.EVENT_READ)
                    self._take_from(link)
            else:
                self._take_from(link)

    def _take_from(self, link: socket.socket) -> None:
        try:
            data = link.recv(_HEAD.size + MOST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._selector.unregister(link)
            link.close()
        elif len(data) >= _HEAD.size:
            self._came.append(_message(data))

    def _look_round(self) -> None:
        """Connects to those who have joined since the folder was last looked at."""
        try:
            changed = os.stat(self._folder).st_mtime_ns
            if changed == self._seen:
                return
            names = set(filter(_NAME.fullmatch, os.listdir(self._folder)))
        except OSError as error:
            raise can.CanOperationError(f"{self._folder}: {error.strerror}") from None
        if self._own.name not in names:
            raise can.CanOperationError(f"{self._own}: was removed")
        for name in set(self._to) - names:
            self._forget(name)
        for name in names - set(self._to) - {self._own.name}:
            self._connect(name)
        # A change within the same tick of the file system's clock would leave the same time.
        self._seen = changed if time.time_ns() - changed > TICK else -1

    def _connect(self, name: str) -> None:
        link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        link.setblocking(False)
        try:
            link.connect(str(self._folder / name))
        except BlockingIOError:  # so many have connected that it has to accept some first
            link.close()
            self._seen = -1
        except ConnectionRefusedError:  # its process was killed
            link.close()
            (self._folder / name).unlink(missing_ok=True)
        except OSError:
            link.close()
        else:
            self._to[name] = link

    def _forget(self, name: str) -> None:
        self._to.pop(name).close()
        self._seen = -1


def _make_private(folder: Path) -> None:
    """The folder, open to this user only; OSError where it is not."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.stat()
    if status.st_uid != os.getuid():
        raise OSError("the folder belongs to another user")
    if stat.S_IMODE(status.st_mode) & 0o077:
        raise OSError("the folder is open to others; it must be a new one, or 'chmod 700'")


def _message(data: bytes) -> can.Message:
    stamp, identifier = _HEAD.unpack_from(data)
    return can.Message(
        timestamp=stamp,
        arbitration_id=identifier & IDENTIFIER,
        is_extended_id=bool(identifier & EXTENDED),
        is_remote_frame=bool(identifier & REMOTE),
        is_error_frame=bool(identifier & ERROR),
        data=data[_HEAD.size :],
    )
