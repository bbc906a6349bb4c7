"""A recording as CSV: the columns of docs/recordings.md, every number to the last bit."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path

import numpy as np

from arm_io import whole_file
from arm_io.types import Array
from daq.recording.blocks import LongRecording
from daq.recording.reader import Recording
from daq.recording.tables.exported import columns_of


def write_csv(path: str | Path, recording: Recording | LongRecording) -> list[str]:
    """Writes a recording as a table, whole or not at all; returns the names of the columns.

    Each number is the shortest text that reads back as the same float64; a missing sample is an empty cell. Tracker
    points whose position in the base frame is unknown are omitted.
    """
    names: list[str] = []
    epoch = recording.provenance.get("epoch")
    with whole_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        for block in recording.blocks():
            columns = columns_of(block)
            if not names:
                names = list(columns)
                writer.writerow(names)
            writer.writerows(zip(*(_texts(values, epoch if name == "t" else None) for name, values in columns.items())))
    return names


def _texts(values: Array, since: str | None) -> Iterable[float | str]:
    """Numbers, of which ``csv`` writes the shortest text that reads back as the same float64; an empty text for NaN.

    since  what is added to each, exactly
    """
    if since is not None:
        return [str(Decimal(since) + Decimal(repr(value))) for value in values.tolist()]
    if not np.isnan(values).any():
        return values.tolist()
    return ("" if value != value else value for value in values.tolist())
