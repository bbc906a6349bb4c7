"""The two TCP connections of a LabJack T7: commands (answered one by one) and the stream."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Callable

from drivers import modbus_tcp as modbus
from drivers.reconnect import in_words


class LinkLost(OSError):
    """The connection is gone or not to be trusted any more; it has been closed."""


class T7Link:
    """Blocking commands with a time limit, and a stream that is read without waiting."""

    def __init__(self, host: str, port: int, stream_port: int, timeout: float) -> None:
        self._addresses = (host, port), (host, stream_port)
        self._timeout = timeout
        self._command: socket.socket | None = None
        self._stream: socket.socket | None = None
        self._transaction = 0
        self.strays = 0  # replies that belonged to no request of ours, or to one given up

    @property
    def connected(self) -> bool:
        return self._command is not None

    def connect(self) -> None:
        """Opens both connections. Raises OSError."""
        self.close()
        try:
            self._command = socket.create_connection(self._addresses[0], self._timeout)
            self._command.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._frames = modbus.Frames()
            self._stream = socket.create_connection(self._addresses[1], self._timeout)
            self._stream.setblocking(False)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        for connection in (self._command, self._stream):
            if connection is not None:
                with contextlib.suppress(OSError):
                    connection.close()
        self._command = self._stream = None

    def read(self, address: int, registers: int) -> bytes:
        """``registers`` from ``address`` on. LinkLost on a loss; FrameError where the T7 refuses."""
        reply = self._exchange(lambda n: modbus.read_request(n, address, registers))
        return modbus.read_data(reply, registers)

    def read_uint(self, address: int) -> int:
        return int.from_bytes(self.read(address, 2), "big")

    def read_float(self, address: int) -> float:
        return float(struct.unpack(">f", self.read(address, 2))[0])

    def write(self, address: int, data: bytes) -> None:
        """Writes and waits for the confirmation. LinkLost on a loss; FrameError where the T7 refuses."""
        reply = self._exchange(lambda n: modbus.write_request(n, address, data))
        modbus.check_written(reply, address, len(data) // 2)

    def write_uint(self, address: int, value: int) -> None:
        self.write(address, struct.pack(">I", value))

    def write_float(self, address: int, value: float) -> None:
        self.write(address, struct.pack(">f", value))

    def write_word(self, address: int, value: int) -> None:
        self.write(address, struct.pack(">H", value))

    def read_stream(self) -> bytes:
        """All stream bytes that have arrived. LinkLost where the T7 has closed the connection."""
        if self._stream is None:
            raise LinkLost("not connected")
        pieces: list[bytes] = []
        while True:
            try:
                piece = self._stream.recv(1 << 16)
            except BlockingIOError:
                break
            except OSError as error:
                self.close()
                raise LinkLost(in_words(error)) from None
            if not piece:
                if pieces:
                    break
                self.close()
                raise LinkLost("the T7 closed the stream connection")
            pieces.append(piece)
        return b"".join(pieces)

    def _exchange(self, request: Callable[[int], bytes]) -> modbus.Frame:
        # Another thread, the guard's, may close the link meanwhile: the socket is then closed, and an OSError says so.
        connection = self._command
        if connection is None:
            raise LinkLost("not connected")
        self._transaction = (self._transaction + 1) & 0xFFFF
        deadline = time.monotonic() + self._timeout
        try:
            connection.sendall(request(self._transaction))
            while (left := deadline - time.monotonic()) > 0:
                connection.settimeout(left)
                data = connection.recv(4096)
                if not data:
                    break
                for frame in self._frames.feed(data):
                    if frame.transaction == self._transaction:
                        return frame
                    self.strays += 1
        except (OSError, modbus.FrameError) as error:
            self.close()
            raise LinkLost(in_words(error) or "no answer in time") from None
        self.close()
        raise LinkLost("no answer in time")
