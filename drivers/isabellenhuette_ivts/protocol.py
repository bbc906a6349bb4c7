"""Isabellenhuette IVT-S on the bus, sans-IO: commands, replies, results; the .dbc in this folder defines the frames.

A result is 6 bytes: channel, state (high nibble) and counter (low nibble), int32 big-endian. The counter shows lost
frames (up to 15 in a row). Configuration is refused while the sensor runs, and 2 ms must pass between commands.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

DATABASE = Path(__file__).with_name("isabellenhuette_ivts.dbc")
COMMAND_ID, REPLY_ID, RESULT_ID = 0x411, 0x511, 0x521  # as delivered

SET_RESULT, SET_MODE = 0x20, 0x34  # + channel
GET_DEVICE, GET_VERSION, GET_SERIAL = 0x79, 0x7A, 0x7B
ALIVE = 0xBF  # first byte of the frame that a sensor sends unasked, from its reply identifier, when it has started
CYCLIC = 2
COMMAND_PAUSE = 0.002  # s
CHANNELS = ("I", "U1", "U2", "U3", "T", "W", "As", "Wh")
RESULT_BYTES, REPLY_BYTES = 6, 8
FULL_SCALE = (1 << 31) - 1  # of the value on the wire


def reply_to(command: int) -> int:
    """First byte of the reply to a command: set commands 20h-3Fh and get commands 40h-7Fh are answered by 80h-BFh."""
    return 0x80 | (command & 0x3F)


def stop_command() -> bytes:
    """No results, now and after power-up."""
    return bytes([SET_MODE, 0, 0, 0, 0, 0, 0, 0])


def run_command() -> bytes:
    """Results from now on, and after power-up."""
    return bytes([SET_MODE, 1, 1, 0, 0, 0, 0, 0])


def cyclic_command(channel: int, milliseconds: int) -> bytes:
    """Channel (0 the current) every so many ms; 0: never."""
    mode = CYCLIC if milliseconds else 0
    return bytes([SET_RESULT + channel, mode, *milliseconds.to_bytes(2, "big"), 0, 0, 0, 0])


def serial_number(reply: bytes) -> str:
    """Of the reply to GET_SERIAL: bytes 1 to 4."""
    return reply[1:5].hex()


def version(reply: bytes) -> str:
    """Of the reply to GET_VERSION: bytes 1 to 3 are hardware (major), minor and revision; its date follows."""
    return ".".join(map(str, reply[1:4]))


def rated_current(reply: bytes) -> int:
    """A, of the reply to GET_DEVICE: 12 bit from byte 2 on; byte 1 is the kind of device (2: IVT-S)."""
    return reply[2] << 4 | reply[3] >> 4


@dataclass(frozen=True)
class Result:
    """One result in A (V, degC ...): its quality flags, and how many frames were lost before it."""

    value: float
    faulty: bool  # out of range, of reduced precision, or marked invalid by the sensor
    saturated: bool
    lost: int


class Results:
    """The results of one channel of one sensor, in the order of arrival."""

    def __init__(self, channel: str = "I") -> None:
        import cantools

        database: Any = cantools.database.load_file(str(DATABASE))
        self._message = database.get_message_by_name(f"Result_{channel}")
        self._channel = CHANNELS.index(channel)
        self._counter: int | None = None
        self.taken = self.lost = 0  # frames, since the beginning

    def take(self, data: bytes) -> Result | None:
        """The result in a frame; None if it is none of this channel's."""
        if len(data) != RESULT_BYTES or data[0] != self._channel:
            return None
        fields = self._message.decode(data)
        counter = int(fields["Counter"])
        lost = 0 if self._counter is None else (counter - self._counter - 1) % 16
        self._counter = counter
        self.taken += 1
        self.lost += lost
        faulty = any(fields[name] for name in ("SystemError", "MeasurementError", "ChannelError"))
        raw = int.from_bytes(data[2:], "big", signed=True)
        return Result(float(fields["Value"]), bool(faulty), abs(raw) >= FULL_SCALE, lost)

    def restart(self) -> None:
        """After a gap that is known otherwise, the counter says nothing."""
        self._counter = None
