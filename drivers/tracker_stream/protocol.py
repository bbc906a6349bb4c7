"""Points of an external tracker as lines of text, sans-IO: ``frame,seconds,x,y,z``.

Frames are counted from 1 at the tracker's start; seconds are the tracker's own; a broken beam leaves x, y, z empty (or
nan). The same lines make the tracker's own file, under a heading. Lengths are in the unit that the rig file says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HEADING = "frame,seconds,x,y,z"
_LONGEST = 200  # characters of a line


@dataclass(frozen=True)
class Frames:
    """n frames: number (n,) int64 from 1; seconds (n,); points (n, 3) in the stream's unit.

    Points are NaN while the beam is broken.
    """

    number: NDArray[np.int64]
    seconds: NDArray[np.float64]
    points: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.number)


class Lines:
    """Cuts text, in pieces of any size, into frames; a line that is none is dropped and counted."""

    def __init__(self) -> None:
        self._rest = b""
        self._amid = False
        self.refused = 0

    def resume(self) -> None:
        """Starts again after the connection was lost, possibly in the middle of a line: skips to the next line end."""
        self._rest, self._amid = b"", True

    def feed(self, data: bytes) -> Frames:
        """Frames of the lines completed by ``data``."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if self._amid and lines:
            lines, self._amid = lines[1:], False
        if len(self._rest) > _LONGEST:
            self._rest, self.refused = b"", self.refused + 1
        rows = []
        for line in lines:
            if line.strip() in (b"", HEADING.encode()):
                continue
            if (row := parse_line(line)) is None:
                self.refused += 1
            else:
                rows.append(row)
        table = np.array(rows, np.float64).reshape(-1, 5)
        return Frames(table[:, 0].astype(np.int64), table[:, 1], table[:, 2:])


def parse_line(line: bytes) -> tuple[float, float, float, float, float] | None:
    """The five fields of a line, or None.

    They are a frame number from 1, a finite time >= 0, and three finite numbers or three blanks.
    """
    fields = line.strip().split(b",")
    if len(fields) != 5 or len(line) > _LONGEST or not fields[0].isdigit() or not 1 <= int(fields[0]) < 1 << 53:
        return None
    blank = [f.strip().lower() in (b"", b"nan") for f in fields[2:]]
    try:
        seconds = float(fields[1])
        x, y, z = (math.nan, math.nan, math.nan) if all(blank) else (float(f) for f in fields[2:])
    except ValueError:
        return None
    if not (math.isfinite(seconds) and seconds >= 0 and (all(blank) or all(map(math.isfinite, (x, y, z))))):
        return None
    return float(int(fields[0])), seconds, x, y, z


def format_line(number: int, seconds: float, point: NDArray[np.float64]) -> bytes:
    """The line of one frame."""
    if np.isnan(point).any():
        return b"%d,%.6f,,,\n" % (number, seconds)
    return b"%d,%.6f,%.9g,%.9g,%.9g\n" % (number, seconds, *point)
