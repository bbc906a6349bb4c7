"""US Digital AD4-B on the wire, sans-IO (US Digital, "AD4B Communications Protocol").

One-byte commands, answers of known length, no frame, no checksum: after any error the line is drained and pinged again.
The counter is an LFLS7166: 24 bit, the fourth byte of a position means nothing.
"""

from __future__ import annotations

PING, POSITION, INITIALISE = b"\x41", b"\x01", 0x22
PONG = b"\x34"
POSITION_BYTES = 4
WIDTH = 24
BAUD = 9600
MULTIPLIERS = {"x1": 1, "x2": 2, "x4": 4}
WIRE_BYTES = len(POSITION) + POSITION_BYTES  # of one question and its answer
RATE = BAUD / 10 / WIRE_BYTES  # rows/s that fit on the wire


def initialise_command(mode: str) -> bytes:
    """Sets the multiplier, and the preset register to 0."""
    return bytes([INITIALISE, MULTIPLIERS[mode], 0, 0, 0, 0])


def confirms_initialise(command: bytes, answer: bytes) -> bool:
    """True if ``answer`` is one byte that can be the checksum of ``command``.

    The document says "checksum" and no more: the sum and the exclusive-or of the bytes, with and without the command
    byte, are taken.
    """
    if len(answer) != 1:
        return False
    xor = 0
    for byte in command:
        xor ^= byte
    sums = {sum(command) & 0xFF, sum(command[1:]) & 0xFF, xor, xor ^ command[0]}
    return answer[0] in sums | {(-s) & 0xFF for s in sums}


def position(answer: bytes) -> int | None:
    """Count of a 4-byte answer (0 ... 2^24 - 1), least significant byte first; None for any other length."""
    if len(answer) != POSITION_BYTES:
        return None
    return int.from_bytes(answer[:3], "little")
