"""Recordings: rows to MCAP, MCAP to arrays; tables, recovery, accounting."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.recording.blocks import LongRecording, open_long
    from daq.recording.losses import warnings_on
    from daq.recording.parts import Attachments, ledger_table
    from daq.recording.plots import plot
    from daq.recording.reader import Recording, open_recording
    from daq.recording.several import open_recordings
    from daq.recording.stretches import Ranges
    from daq.recording.tables.columns import Table
    from daq.recording.tables.csv_reader import read_csv
    from daq.recording.tables.csv_time import TimeUnit
    from daq.recording.tables.csv_writer import write_csv
    from daq.recording.tables.table import write_blocks, write_table
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Attachments",
    "LongRecording",
    "Ranges",
    "Recording",
    "Table",
    "TimeUnit",
    "ledger_table",
    "open_long",
    "open_recording",
    "open_recordings",
    "plot",
    "read_csv",
    "warnings_on",
    "write_blocks",
    "write_csv",
    "write_table",
]
