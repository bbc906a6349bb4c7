"""Several recordings opened for one analysis, within one bound on the memory of all."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader

from arm_io import InputError
from arm_io.files import open_regular
from daq.recording.messages.row_format import format_of
from daq.recording.reader import Recording, open_recording
from daq.recording.thinned import MOST_NUMBERS

BYTES = 40
"""Of a file, at least, per row and joint; a simulation that repeats itself may take less."""


@dataclass(frozen=True)
class Extent:
    """How much a file holds, before it is read: rows, joints, and s from the first row to the last."""

    rows: int
    joints: int
    seconds: float

    @property
    def numbers(self) -> int:
        """Rows times joints."""
        return self.rows * self.joints


def open_recordings(
    *groups: Sequence[Path], most_numbers: int = MOST_NUMBERS, rate: float | None = None
) -> list[list[Recording]]:
    """Reads recordings for an analysis, in groups as given (fitted, held out).

    Every row is read as long as all recordings together have at most ``most_numbers`` rows times joints. Else each is
    reduced to its share of that number by averaging rows (``daq.recording.thinned``). Raises InputError as
    ``open_recording`` does.

    rate  rows/s that suffice: those of faster recordings are averaged, down to no fewer than so many; None: no bound on
          the rate
    """
    extents = {path: extent_of(path) for group in groups for path in group}
    total = sum(extent.numbers for extent in extents.values())

    def opened(path: Path) -> Recording:
        extent, most = extents[path], most_numbers
        if total > most_numbers:
            most = most_numbers * extent.numbers // total
        if rate is not None and extent.seconds > 0.0:
            # by intervals, rounded: 2 kHz must be twice 1 kHz exactly
            times = (extent.rows - 1) / (rate * extent.seconds)
            halvings = math.ceil(math.log2(max(times, 1.0)) - 1e-6) - 1
            if halvings > 0:
                # an even number of rows, since an odd one would be halved once more
                kept = -(-extent.rows // 2**halvings)
                most = min(most, (kept + kept % 2) * extent.joints)
        return open_recording(path, most_numbers=most)

    return [[opened(path) for path in group] for group in groups]


def extent_of(path: Path) -> Extent:
    """Rows and duration of a recording, from its summary.

    Of an unfinished or damaged file without a summary: as many rows as its size allows. An absent file has none.
    """
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            size = file.seek(0, 2)
            file.seek(0)
            try:
                summary = make_reader(file).get_summary()
            except Exception:  # the library raises anything over a damaged file; its size is still known
                summary = None
    except (InputError, OSError):  # reported when it is read
        return Extent(0, 1, 0.0)
    rows_of = [channel for channel in summary.channels.values() if "layout" in channel.metadata] if summary else []
    if summary is None or summary.statistics is None or not rows_of:
        return Extent(size // BYTES, 1, 0.0)
    seen = summary.statistics
    rows = seen.channel_message_counts.get(rows_of[0].id, 0)
    try:
        joints = len(format_of(rows_of[0].metadata["layout"]).layout.joints)
    except ValueError:  # a damaged layout, reported when it is read
        joints = 1
    return Extent(rows, joints, (seen.message_end_time - seen.message_start_time) * 1e-9)
