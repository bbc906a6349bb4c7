"""What channels lost at one instant: rows, and counts of an encoder."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class LostRows:
    """Rows that channels of a recording lost at one instant.

    file   name of the recording
    joint  whose counter lost them, alone (from 1); None: all counters, or all currents
    row    of the recorded columns: the first after the loss, from 0; time: s of that instant
    count  number of rows; negative: of angles
    row_std  of ``row``; a jump of an angle is at one row, a change of lag is seen over many
    """

    file: str
    joint: int | None
    row: int
    time: float
    count: int
    row_std: float = 0.0


@dataclass(frozen=True, kw_only=True)
class EncoderJump:
    """Counts that an encoder missed at one instant.

    file   name of the recording; joint: from 1
    row    the first with the offset, from 0; time: s of that row
    counts  gained; negative: lost; std: of their number
    """

    file: str
    joint: int
    row: int
    time: float
    counts: int
    std: float
