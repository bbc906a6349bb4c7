"""Recordings without devices behind them: tables, in and out, and the mapping of foreign ones."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.recording.tables.columns import Table, read_blocks
    from daq.recording.tables.csv_header import first_names
    from daq.recording.tables.mapping import Mapping, read_mapping
    from daq.recording.tables.matlab_writer import write_matlab
    from daq.recording.tables.parquet_writer import write_parquet
    from daq.recording.tables.ros_bag_writer import write_bag
    from daq.recording.tables.sources import guessed, open_source
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Mapping",
    "Table",
    "first_names",
    "guessed",
    "open_source",
    "read_blocks",
    "read_mapping",
    "write_bag",
    "write_matlab",
    "write_parquet",
]
