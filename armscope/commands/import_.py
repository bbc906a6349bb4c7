"""``armscope import``: measured data from elsewhere becomes a recording."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError, counted, write_text
from armscope.api.importing import Reading, write_import
from armscope.commands.options import Json, RecordingOut
from armscope.exit_status import DONE, SAMPLES_LOST
from armscope.progress import shown
from daq.recording import TimeUnit
from daq.recording.tables import Mapping, read_mapping


def command(
    table: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE",
            help="CSV, Parquet, .mat or HDF5 with t, q1.., i1.. (and qref, ql, v, temp per joint, x, y, z), or under "
            "other names; or a ROS 2 bag with JointState (its folder, .mcap or .db3)",
        ),
    ],
    out: RecordingOut,
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG.toml", help="rig file with the joints; default: joints from the columns")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="without a rig file: the model (TOML, URDF, MJCF) with the joints, their names, order and motors",
        ),
    ] = None,
    keep_extra: Annotated[bool, typer.Option("--keep-extra", help="keep columns with unknown names")] = False,
    time_unit: Annotated[
        TimeUnit | None,
        typer.Option("--time-unit", help="unit of the column t; required if its values do not look like s"),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option("--map", metavar="MAPPING.toml", help="names, units and separators of the columns")
    ] = None,
    guess: Annotated[bool, typer.Option("--guess", help="accept the mapping that the names suggest")] = False,
    save_map: Annotated[
        Path | None, typer.Option("--save-map", metavar="MAPPING.toml", help="also write the mapping, to edit")
    ] = None,
    topic: Annotated[str | None, typer.Option(help="of a ROS 2 bag: the topic of the joints")] = None,
    recorded: Annotated[
        bool,
        typer.Option(
            "--recorded-times", help="of a ROS 2 bag: use the times of recording, not the stamps in the headers"
        ),
    ] = False,
    date: Annotated[
        str | None,
        typer.Option(
            metavar="DATE",
            help="when a table without dates was recorded, UTC: 2026-03-01, 2026-03-01T10:00; default: now",
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    with shown(as_json):
        reading = Reading(
            rig=rig,
            model=model,
            mapping=None if mapping is None else read_mapping(mapping),
            keep_extra=keep_extra,
            time_unit=time_unit,
            topic=topic,
            recorded_times=recorded,
            date=date,
        )
        done = write_import(
            table,
            out,
            reading,
            accept=lambda path, found: guess or _confirmed(path, found),
            save=lambda found: None if save_map is None else write_text(save_map, _text(table, found)),
            say=lambda note: print(f"note: {note}", file=sys.stderr),
        )
    if as_json:
        # of a bag that is cut off, the number of messages that followed is unknown
        lost = None if done.cut else 0
        found = {"file": str(out), "rows": done.rows, "joints": done.joints, "duration": done.seconds, "lost": lost}
        print(json.dumps(found))
    else:
        gaps = f", {counted(done.missing, 'row')} with missing samples" if done.missing else ""
        print(f"{out}: {counted(done.rows, 'row')} of {counted(done.joints, 'joint')}, {done.seconds:.2f} s{gaps}")
    return SAMPLES_LOST if done.cut else DONE


def _confirmed(table: Path, found: Mapping) -> bool:
    """Whether a person at a terminal accepts a mapping; False without a terminal. InputError: the person does not."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    print(f"{table} seems to mean: {found.in_words()}", file=sys.stderr)
    if typer.confirm("Is this right?", err=True):
        return True
    raise InputError(
        table, "not imported; --guess --save-map MAPPING.toml writes this mapping, to be edited and given to --map"
    )


def _text(table: Path, mapping: Mapping | None) -> str:
    if mapping is None:
        raise InputError("--save-map", f"{table} has the names and units of armscope; there is no mapping to write")
    return f"# Columns of {table.name}; docs/recordings.md explains the entries.\n\n{mapping.text()}"
