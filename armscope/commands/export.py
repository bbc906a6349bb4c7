"""``armscope export``: a recording becomes a table, or a ROS 2 bag."""

from __future__ import annotations

import json
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError
from armscope.commands.options import Json
from armscope.progress import shown
from daq.recording import LongRecording, open_long, write_csv
from daq.recording.tables import write_bag, write_matlab, write_parquet


class Format(StrEnum):
    """What a recording can become."""

    CSV = "csv"
    PARQUET = "parquet"
    MAT = "mat"
    ROS2 = "ros2"
    ROS2_MCAP = "ros2-mcap"


def command(
    recording: Annotated[Path, typer.Argument(metavar="RUN.mcap", help="the recording")],
    out: Annotated[Path, typer.Option(help="the .csv, .parquet or .mat to write, or a folder; must not exist yet")],
    to: Annotated[
        Format | None,
        typer.Option(
            help="format; default: by the ending of --out, else csv; ros2: a bag in sqlite3, ros2-mcap: in MCAP"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    form = to or _by_ending(out)
    if os.path.isfile(out):
        # whether a table was exported or measured cannot be seen
        raise InputError(out, "exists already, and may be the only copy of its data; use another name")
    with shown(as_json) as progress:
        data = open_long(recording)
        progress("writing")
        columns = _write(form, out, data)
    if (
        data.layout.points == "tracker"
        and data.base_from_tracker is None
        and form not in (Format.ROS2, Format.ROS2_MCAP)
    ):
        print("the tracker points are left out: the rig file has no base_from_tracker", file=sys.stderr)
    if as_json:
        print(json.dumps({"file": str(out), "rows": len(data), "columns": columns, "lost": data.ledger.lost}))
    else:
        what = "topics" if form in (Format.ROS2, Format.ROS2_MCAP) else "columns"
        print(f"{out}: {len(data)} rows, {what} {', '.join(columns)}")


def _by_ending(out: Path) -> Format:
    """The format that a name ends with; CSV for endings that say nothing. InputError for one that says another."""
    ending = out.suffix.lower()
    if ending in (".mcap", ".db3"):
        raise InputError(out, "a bag is a folder: --to ros2-mcap or ros2, and --out FOLDER")
    if ending in _OF_OTHERS:
        raise InputError(out, "is no name of a format that is written; it must end in .csv, .parquet or .mat")
    return {".parquet": Format.PARQUET, ".pq": Format.PARQUET, ".mat": Format.MAT}.get(ending, Format.CSV)


_OF_OTHERS = (
    ".h5",
    ".hdf5",
    ".xls",
    ".xlsx",
    ".ods",
    ".docx",
    ".pdf",
    ".html",
    ".zip",
    ".gz",
    ".json",
    ".feather",
    ".npy",
    ".npz",
    ".bag",
    ".png",
    ".toml",
)
"""Endings of files that are no tables as text."""


def _write(form: Format, out: Path, data: LongRecording) -> list[str]:
    """Names of the columns, matrices or topics written."""
    match form:
        case Format.CSV:
            return write_csv(out, data)
        case Format.PARQUET:
            return write_parquet(out, data)
        case Format.MAT:
            return write_matlab(out, data)
        case _:
            return write_bag(out, data, "mcap" if form is Format.ROS2_MCAP else "sqlite3")
