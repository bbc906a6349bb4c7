"""Several recordings opened for one analysis, within one bound on the memory of all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mcap.reader import make_reader

from arm_io import InputError
from arm_io.files import open_regular
from daq.recording.messages.row_format import format_of
from daq.recording.reader import Recording, open_recording
from daq.recording.thinned import MOST_NUMBERS

BYTES = 40
"""Of a file, at least, per row and joint; a simulation that repeats itself may take less."""


def open_recordings(*groups: Sequence[Path], most_numbers: int = MOST_NUMBERS) -> list[list[Recording]]:
    """Reads recordings for an analysis, in groups as given (fitted, held out).

    Every row is read as long as all recordings together have at most ``most_numbers`` rows times joints. Else each is reduced to its share of
    that number by averaging rows (``daq.recording.thinned``). Raises InputError as ``open_recording`` does.
    """
    numbers = {path: numbers_of(path) for group in groups for path in group}
    total = sum(numbers.values())

    def opened(path: Path) -> Recording:
        share = most_numbers if total <= most_numbers else most_numbers * numbers[path] // total
        return open_recording(path, most_numbers=share)

    return [[opened(path) for path in group] for group in groups]


def numbers_of(path: Path) -> int:
    """Rows times joints of a recording: from the summary of a finished one, else at most, by its size; 0 where there is no such file."""
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            size = file.seek(0, 2)
            file.seek(0)
            try:
                summary = make_reader(file).get_summary()
            except Exception:  # the library raises anything over a damaged file; its size still tells
                summary = None
    except (InputError, OSError):  # told when it is read
        return 0
    layouts = [c.metadata["layout"] for c in summary.channels.values() if "layout" in c.metadata] if summary else []
    if summary is None or summary.statistics is None or not layouts:
        return size // BYTES
    rows = summary.statistics.message_count // max(summary.statistics.channel_count, 1)
    return rows * len(format_of(layouts[0]).layout.joints)
