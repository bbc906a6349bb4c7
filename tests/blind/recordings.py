"""What was taken of a hidden case, as the finder gets it: MCAP files, written and read back."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from daq.recording import Recording, open_recording
from daq.recording_file import Attachments
from daq.table import write_table
from tests.blind.record import Taken


def recordings_of(taken: Sequence[Taken], names: Sequence[str]) -> list[Recording]:
    """One recording each, through a file of its own."""
    read = []
    with tempfile.TemporaryDirectory() as folder:
        for one, name in zip(taken, names):
            path = Path(folder) / f"{name.replace(' ', '_')}.mcap"
            write_table(path, one.t, {"q": one.q, "i": one.i, "qref": one.qref}, Attachments())
            read.append(open_recording(path))
    return read
