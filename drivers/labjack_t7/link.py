"""The two TCP connections of a LabJack T7: commands (answered one by one) and the stream."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable

from drivers import modbus_tcp as modbus
from drivers.reconnect import in_words


class LinkLost(OSError):
    """The connection is gone or not to be trusted any more; it has been closed."""


class T7Link:
    """Blocking commands with a time limit, and a stream that is read without waiting.

    Commands may come from any thread, one at a time: an answer is found among the bytes of one connection.
    """

    def __init__(self, host: str, port: int, stream_port: int, timeout: float) -> None:
        self._addresses = (host, port), (host, stream_port)
        self._timeout = timeout
        self._command: socket.socket | None = None
        self._stream: socket.socket | None = None
        self._transaction = 0
        self._busy = threading.Lock()
        self.strays = 0  # replies that belonged to no request of ours, or to one given up

    @property
    def connected(self) -> bool:
        return self._command is not None

    def connect(self) -> None:
        """Opens both connections. Raises OSError."""
        self.close()
        try:
            command = self._new_command_connection()
            self._frames, self._command = modbus.Frames(), command
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

    def write_afresh(self, writes: Iterable[tuple[int, bytes]]) -> int:
        """Writes each (address, data) over a connection of its own, whatever became of those before.

        Returns how many were confirmed. OSError where the T7 takes no connection.
        """
        confirmed = 0
        with self._new_command_connection() as connection:
            frames = modbus.Frames()
            for number, (address, data) in enumerate(writes):
                with contextlib.suppress(OSError):
                    request = modbus.write_request(number, address, data)
                    reply, _ = _exchanged(connection, frames, request, number, self._timeout)
                    if reply is not None:
                        modbus.check_written(reply, address, len(data) // 2)
                        confirmed += 1
        return confirmed

    def _new_command_connection(self) -> socket.socket:
        connection = socket.create_connection(self._addresses[0], self._timeout)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

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
        # Whoever has the lock gives it back after two time limits at the latest: one to send, one for the answer.
        if not self._busy.acquire(timeout=2 * self._timeout):
            raise LinkLost("other commands wait for their answers")
        try:
            # Another thread, the guard's, may close the link meanwhile: an OSError then says so.
            connection = self._command
            if connection is None:
                raise LinkLost("not connected")
            self._transaction = number = (self._transaction + 1) & 0xFFFF
            try:
                reply, strays = _exchanged(connection, self._frames, request(number), number, self._timeout)
            except (OSError, modbus.FrameError) as error:
                self._lose(connection)
                raise LinkLost(in_words(error) or "no answer in time") from None
            self.strays += strays
            if reply is None:
                self._lose(connection)
                raise LinkLost("no answer in time")
            return reply
        finally:
            self._busy.release()

    def _lose(self, connection: socket.socket) -> None:
        """Closes the link, unless another thread has connected it anew."""
        if self._command is connection:
            self.close()


def _exchanged(
    connection: socket.socket, frames: modbus.Frames, request: bytes, number: int, timeout: float
) -> tuple[modbus.Frame | None, int]:
    """The answer with transaction ``number``, None where none comes within ``timeout`` s; how many others came."""
    strays = 0
    connection.settimeout(timeout)
    connection.sendall(request)
    deadline = time.monotonic() + timeout
    while (left := deadline - time.monotonic()) > 0:
        connection.settimeout(left)
        try:
            data = connection.recv(4096)
        except TimeoutError:
            break
        if not data:
            break
        for frame in frames.feed(data):
            if frame.transaction == number:
                return frame, strays
            strays += 1
    return None, strays
