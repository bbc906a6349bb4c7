"""The source of columns that a path means: by its ending, or as a text; and which mapping it is read with."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from arm_io import InputError
from daq.recording.tables.columns import Source
from daq.recording.tables.csv_header import FROM_ZERO
from daq.recording.tables.csv_reader import CsvSource
from daq.recording.tables.guess import guess, guess_csv
from daq.recording.tables.mapping import Mapping
from daq.recording.tables.matlab import MatlabSource
from daq.recording.tables.parquet import ParquetSource
from daq.recording.tables.ros_bag import BagSource, is_bag


def open_source(
    path: Path,
    *,
    mapping: Mapping | None = None,
    topic: str | None = None,
    joints: Sequence[str] = (),
    recorded: bool = False,
) -> Source:
    """The columns of a file: ROS 2 bag (folder, .mcap, .db3), Parquet, .mat, HDF5, else CSV.

    mapping        its separator and decimal sign, of a CSV
    topic, joints, recorded  of a bag, as ``BagSource`` has them
    InputError where it cannot be read.
    """
    if is_bag(path):
        return BagSource(path, topic=topic, joints=joints, recorded=recorded)
    for option, is_given in {"--recorded-times": recorded, "--topic": topic is not None}.items():
        if is_given:
            raise InputError(option, f"is for ROS 2 bags only; {path} is not one (its folder, .mcap, .db3)")
    if os.path.isdir(path):
        raise InputError(
            path,
            "is a folder without metadata.yaml, whose files are no parts of one bag (NAME_0.mcap, NAME_1.mcap, ..); "
            "the name of a file is needed",
        )
    match path.suffix.lower():
        case ".parquet" | ".pq":
            return ParquetSource(path)
        case ".mat" | ".h5" | ".hdf5":
            return MatlabSource(path)
    return CsvSource(path) if mapping is None else CsvSource(path, mapping.separator, mapping.decimal)


def ours(names: Sequence[str]) -> bool:
    """Whether a table has the required columns under armscope's own names.

    Columns q0 and i0 show that its joints count from 0; then q1 is the second joint, not the first.
    """
    return {"t", "q1", "i1"} <= set(names) and not any(map(FROM_ZERO.fullmatch, names))


def guessed(path: Path, joints: Sequence[str] = ()) -> Mapping | None:
    """The mapping that a file suggests; None where it has our names, says itself what is what, or says too little.

    joints  names of the arm's joints, where they are known: the order of columns named by them
    InputError where it cannot be read.
    """
    if is_bag(path) or os.path.isdir(path):
        return None
    if path.suffix.lower() in (".parquet", ".pq", ".mat", ".h5", ".hdf5"):
        source = open_source(path)
        if ours(source.names):
            return None
        try:
            first = next(islice(source.chunks(source.names, source.names[0]), 1), None)
        except InputError:  # a column without numbers, which no mapping names
            first = None
        return guess(source.names, None if first is None else first.columns, joints)
    found = guess_csv(path, joints)
    if found is not None and found.separator == "," and found.decimal == ".":
        return None if ours(CsvSource(path).names) else found
    return found
