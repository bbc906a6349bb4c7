"""US Digital QSB on the wire, sans-IO (QSB command list 1.28).

Commands are ASCII: ``R``ead, ``W``rite or ``S``tream, a two-digit hex register, hex data for a write, carriage return.
Replies: the command's letter in lower case, the register, eight hex digits, with time stamps eight more, ``!``; ``e``
instead of the letter for an error, ``x`` for a command that the QSB does not know. What follows the ``!`` (CR, LF) and
spaces between the fields are options of register 15.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

MDR0, CLEAR, INTERVAL, TIME, COUNT, VERSION, OPTIONS = 0x03, 0x09, 0x0C, 0x0D, 0x0E, 0x14, 0x15
FREE_RUNNING = {"x1": 1, "x2": 2, "x4": 3}  # MDR0: multiplier in bits 0-1, free-running count
CLEAR_COUNTER = 2  # written to CLEAR: the count is 0
BARE = 0  # OPTIONS: no CR, no LF, no stamp, no spaces: 12 bytes a reply
TIME_HZ = 512.0  # TIME: 1.95 ms a tick since power-up
BAUD = 230_400
STREAM_RATE = BAUD / 10 / 12  # replies/s that fit on the wire

_REPLY = re.compile(rb"([rwsex])([0-9A-F]{2})([0-9A-F]{8})([0-9A-F]{8})?!")
_LONGEST = 64  # bytes without a whole reply: nothing the QSB sends is so long


@dataclass(frozen=True)
class Reply:
    """One reply: its letter, register, value (32 bit unsigned) and, where asked for, time stamp in ticks of 1/512 s."""

    kind: str
    register: int
    value: int
    stamp: int | None


def read_command(register: int) -> bytes:
    """Asks for the value of a register once."""
    return b"R%02X\r" % register


def write_command(register: int, value: int, digits: int = 0) -> bytes:
    """Sets a register; the value with at least so many hex digits."""
    return b"W%02X%0*X\r" % (register, digits, value)


def stream_command(register: int) -> bytes:
    """Asks for the value of a register again and again, as the register INTERVAL says."""
    return b"S%02X\r" % register


class Replies:
    """Cuts the byte stream into replies; what is none is dropped and counted.

    ``stamped``: True or False where the options are known, so that a reply that lost just its stamp's length is
    refused; None: both are taken.
    There is no checksum: a digit turned into another digit by noise cannot be seen here.
    """

    def __init__(self, stamped: bool | None = None) -> None:
        self.stamped = stamped
        self._buffer = b""
        self.garbage = 0  # bytes
        self.line_ends = 0  # CR and LF

    def feed(self, data: bytes) -> list[Reply]:
        """Replies completed by ``data``. A reply that lost bytes is no reply: the next whole one is found behind it."""
        self.line_ends += data.count(b"\r") + data.count(b"\n")
        self._buffer += data.replace(b"\r", b"").replace(b"\n", b"").replace(b" ", b"")
        replies, end = [], 0
        while (stop := self._buffer.find(b"!", end)) >= 0:
            match = _REPLY.fullmatch(self._buffer, end, stop + 1)
            if match is None or (self.stamped is not None and self.stamped != (match[4] is not None)):
                self.garbage += stop + 1 - end
            else:
                kind, register, value, stamp = match.groups()
                replies.append(
                    Reply(kind.decode(), int(register, 16), int(value, 16), None if stamp is None else int(stamp, 16))
                )
            end = stop + 1
        self._buffer = self._buffer[end:]
        if len(self._buffer) > _LONGEST:
            self.garbage += len(self._buffer)
            self._buffer = b""
        return replies
