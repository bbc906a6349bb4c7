"""Modbus TCP, as far as measuring instruments need it: read (3) and write (16) of holding registers, sans-IO.

Frame: transaction u16, protocol u16 (0), length u16 (of what follows), unit u8, function u8, body; all big-endian
(MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 3.1.3). A reply belongs to the request that carries its
transaction number.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

READ, WRITE, EXCEPTION = 3, 16, 0x80
UNIT = 1  # of every request
LONGEST = 260  # bytes of a frame: the standard's limit
EXCEPTIONS = {
    1: "function not known",
    2: "no such register",
    3: "value not allowed",
    4: "device failure",
    6: "device busy",
}


class FrameError(OSError):
    """Bytes that are not a Modbus TCP frame.

    The next frame cannot be found in such a stream, so the connection must be closed.
    """


@dataclass(frozen=True)
class Frame:
    """One frame: its transaction number, unit and function, and the bytes after them."""

    transaction: int
    unit: int
    function: int
    body: bytes


def encode(frame: Frame) -> bytes:
    """The frame as bytes."""
    return struct.pack(">HHHBB", frame.transaction, 0, len(frame.body) + 2, frame.unit, frame.function) + frame.body


def read_request(transaction: int, address: int, registers: int) -> bytes:
    """Asks for ``registers`` 16-bit registers from ``address`` on."""
    return encode(Frame(transaction, UNIT, READ, struct.pack(">HH", address, registers)))


def write_request(transaction: int, address: int, data: bytes) -> bytes:
    """Writes ``data`` (2 bytes a register) from ``address`` on."""
    return encode(Frame(transaction, UNIT, WRITE, struct.pack(">HHB", address, len(data) // 2, len(data)) + data))


def read_data(reply: Frame, registers: int) -> bytes:
    """The registers in the reply to a read of ``registers``; FrameError if it is an exception or another length."""
    if reply.function == READ | EXCEPTION:
        raise FrameError(f"read refused: {_exception(reply.body)}")
    if reply.function != READ or len(reply.body) != 1 + 2 * registers or reply.body[0] != 2 * registers:
        raise FrameError(
            f"function {reply.function} with {len(reply.body)} bytes is not a reply to a read of {registers}"
        )
    return reply.body[1:]


def check_written(reply: Frame, address: int, registers: int) -> None:
    """FrameError unless the reply confirms a write of ``registers`` at ``address``."""
    if reply.function == WRITE | EXCEPTION:
        raise FrameError(f"write to register {address} refused: {_exception(reply.body)}")
    if reply.function != WRITE or reply.body != struct.pack(">HH", address, registers):
        raise FrameError(f"function {reply.function} does not confirm the write to register {address}")


def _exception(body: bytes) -> str:
    return EXCEPTIONS.get(body[0], f"exception {body[0]}") if len(body) == 1 else "malformed exception"


class Frames:
    """Cuts a byte stream, in pieces of any size, into frames."""

    def __init__(self, longest: int = LONGEST) -> None:
        self._buffer = bytearray()
        self._longest = longest

    def feed(self, data: bytes) -> list[Frame]:
        """Frames completed by ``data``. Raises FrameError on a header that cannot be one."""
        self._buffer += data
        frames = []
        while len(self._buffer) >= 8:
            transaction, protocol, length, unit, function = struct.unpack_from(">HHHBB", self._buffer)
            if protocol != 0 or not 2 <= length <= self._longest - 6:
                raise FrameError(f"protocol {protocol}, length {length}: not a Modbus TCP header")
            if len(self._buffer) < 6 + length:
                break
            frames.append(Frame(transaction, unit, function, bytes(self._buffer[8 : 6 + length])))
            del self._buffer[: 6 + length]
        return frames
