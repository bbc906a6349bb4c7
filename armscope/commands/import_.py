"""``armscope import``: measured data from elsewhere becomes a recording."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from arm_io import InputError, read_text, write_text
from arm_io.dates import utc_date_of
from arm_io.types import Array
from armscope.commands.options import Json, RecordingOut
from armscope.exit_status import DONE, SAMPLES_LOST
from armscope.progress import shown
from daq.recording import Attachments, Table, TimeUnit, write_blocks
from daq.recording.provenance import file_identity, provenance
from daq.recording.tables import Mapping, first_names, guessed, open_source, read_blocks, read_mapping
from daq.rig import LONGEST_RIG_NAME, read_rig

if TYPE_CHECKING:
    from arm_clearance import Chain
    from daq.rig import Rig


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
    when = _date(date)
    checked = _joints_of(rig, model)
    names = [] if checked is None else [joint.name or f"joint{number}" for number, joint in enumerate(checked.joint, 1)]
    chosen = read_mapping(mapping) if mapping is not None else _guessed(table, guess, names)
    with shown(as_json):
        source = open_source(table, mapping=chosen, topic=topic, joints=names, recorded=recorded)
        others = [] if chosen is None or keep_extra else chosen.left_out(source)
        chosen = chosen or source.mapping
        if chosen is not None and mapping is None:
            print(f"note: {table}: {chosen.in_words()}", file=sys.stderr)
        if others:
            print(
                f"note: {table}: {len(others)} column{'s' * (len(others) > 1)} left out: {first_names(others)}",
                file=sys.stderr,
            )
        joints = None if checked is None else checked.joints
        torques = chosen is not None and chosen.torques
        per_current = _torque_per_current(checked) if torques else None
        blocks = _Blocks(
            read_blocks(source, joints=joints, keep_extra=keep_extra, unit=time_unit, mapping=chosen), per_current
        )
        first = next(blocks)
        if save_map is not None:
            write_text(save_map, _text(table, chosen))
        if when and first.epoch is not None:
            raise InputError("--date", f"is for a table without dates; {table} has the dates of its rows")
        attachments = _attachments(table, rig, checked, first, chosen, per_current)
        attachments.provenance.update(when)
        effort = (per_current or [1.0] * first.joints) if torques else ()
        named: Sequence[str] = names or getattr(source, "joints", ())
        write_blocks(out, first, blocks, attachments, joints=named, effort=effort)
        for note in getattr(source, "notes", list)():
            print(f"note: {table}: {note}", file=sys.stderr)
    rows, seconds = blocks.rows, blocks.last - float(first.t[0])
    if as_json:
        print(json.dumps({"file": str(out), "rows": rows, "joints": first.joints, "duration": seconds, "lost": 0}))
    else:
        gaps = f", {blocks.missing} row{'s' * (blocks.missing > 1)} with missing samples" if blocks.missing else ""
        print(f"{out}: {rows} rows of {first.joints} joint{'s' * (first.joints > 1)}, {seconds:.2f} s{gaps}")
    if chosen is None or "q" not in chosen.units:
        _doubt_radians(out, blocks.farthest, checked)
    return SAMPLES_LOST if getattr(source, "cut", False) else DONE


def _date(text: str | None) -> dict[str, str]:
    """What a recording says of when its table was recorded; {} where that is not stated."""
    if text is None:
        return {}
    moment = utc_date_of(text)
    if moment is None:
        raise InputError("--date", f"must be a day or a moment, as 2026-03-01 or 2026-03-01T10:00 (is {text!r})")
    return {"recorded": moment}


def _joints_of(rig: Path | None, model: Path | None) -> Rig | None:
    """The rig file, or a rig that is the joints of a model; None without either."""
    from arm_model import read_model
    from daq.rig import Rig

    if model is None:
        return None if rig is None else read_rig(rig, drivers=False)
    if rig is not None:
        raise InputError("--model", f"is for a table without a rig; {rig} names its model itself")
    arm = read_model(model)
    joints = [
        {"name": joint.name or f"joint{number}", "type": "revolute" if joint.revolute else "prismatic"}
        for number, joint in enumerate(arm.joints, 1)
    ]
    return Rig.model_validate({"name": arm.name[:LONGEST_RIG_NAME], "model": str(model), "joint": joints})


def _doubt_radians(out: Path, farthest: Array, rig: Rig | None) -> None:
    """A note where a joint that turns goes beyond two turns, and nobody said that the unit is rad."""
    turning = [rig is None or rig.joint[j].unit == "rad" for j in range(len(farthest))]
    wide = [j for j, angle in enumerate(farthest) if turning[j] and angle > 4 * math.pi]
    if wide:
        print(
            f"note: {out}: joint {wide[0] + 1} reaches {farthest[wide[0]]:.4g} rad, more than two turns; if the table "
            'has degrees, import it with a mapping that says q = "deg" under [units] (--map)',
            file=sys.stderr,
        )


def _attachments(
    table: Path,
    rig: Path | None,
    checked: Rig | None,
    first: Table,
    chosen: Mapping | None,
    per_current: list[float] | None,
) -> Attachments:
    """Rig, model, and where the rows come from."""
    model = None if checked is None else checked.model_path
    details: dict[str, Any] = {} if first.epoch is None else {"epoch": str(first.epoch)}
    if rig is None and checked is not None:
        details["joint_types"] = [joint.type for joint in checked.joint]
    if chosen is not None:
        details |= {
            "mapping": chosen.model_dump(exclude_none=True, exclude_defaults=True),
            "current_unit": _unit(chosen, per_current),
        }
    return Attachments(
        rig=None if rig is None else read_text(rig),
        model=None if model is None else read_text(model),
        provenance=provenance("imported", source=_identity(table), **details),
        chain=_chain(model, first),
    )


def _guessed(table: Path, accepted: bool, joints: Sequence[str]) -> Mapping | None:
    """The mapping that a table suggests, once a person has accepted it; None where it needs none.

    InputError where it was not.
    """
    found = guessed(table, joints)
    if found is None or accepted:
        return found
    words = found.in_words()
    if sys.stdin.isatty() and sys.stderr.isatty():
        print(f"{table} seems to mean: {words}", file=sys.stderr)
        if typer.confirm("Is this right?", err=True):
            return found
        raise InputError(
            table, "not imported; --guess --save-map MAPPING.toml writes this mapping, to be edited and given to --map"
        )
    raise InputError(
        table,
        f"has other columns than t, q1, i1, .. (joints count from 1); it seems to mean {words}: --guess accepts this, "
        "--map takes a file",
    )


def _text(table: Path, mapping: Mapping | None) -> str:
    if mapping is None:
        raise InputError("--save-map", f"{table} has the names and units of armscope; there is no mapping to write")
    return f"# Columns of {table.name}; docs/recordings.md explains the entries.\n\n{mapping.text()}"


def _identity(table: Path) -> dict[str, Any]:
    """Of a file, or of the files of a bag's folder."""
    if not table.is_dir():
        return file_identity(table)
    return {"name": table.name, "files": [file_identity(path) for path in sorted(table.iterdir()) if path.is_file()]}


def _unit(mapping: Mapping, per_current: list[float] | None) -> str:
    """Of ``i`` in the recording."""
    unit = (mapping.units_of("i", 1) or ["drive"])[0]
    return "A" if unit == "mA" or (mapping.torques and per_current) else unit


def _chain(model: Path | None, first: Table) -> Chain | None:
    """The arm for viewers; None without a model, for another number of joints, or where it floats without a pose."""
    from arm_model import read_model
    from arm_model.collision import chain_of

    if model is None or ((arm := read_model(model)).floating is not None and not first.has_pose):
        return None
    chain = chain_of(arm)
    return chain if len(chain) == first.joints else None


def _torque_per_current(rig: Rig | None) -> list[float] | None:
    """N m/A (N/A) of each joint by the rig's model; None where it states no motors, and torques stay torques."""
    from arm_model import read_model

    if rig is None or rig.model_path is None:
        return None
    constants = [joint.drive_constant for joint in read_model(rig.model_path).joints]
    return None if all(constant == 1.0 for constant in constants) else constants


class _Blocks(Iterator[Table]):
    """The blocks of a table, counted as they go by: rows, those with missing samples, and the last time, s.

    per_current  N m/A (N/A) of each joint by which ``i``, torques, is divided; None: ``i`` stays as it is
    farthest     (J,) rad (m): largest distance of each joint from 0
    """

    def __init__(self, blocks: Iterator[Table], per_current: list[float] | None) -> None:
        self._blocks, self._per_current = blocks, per_current
        self.rows = self.missing = 0
        self.farthest: Array = np.zeros(0)
        self.last = 0.0

    def __next__(self) -> Table:
        block = next(self._blocks)
        self.rows += len(block)
        self.missing += block.rows_with_missing_samples
        far = np.nanmax(np.abs(block.signals["q"]), axis=0, initial=0.0)
        self.farthest = np.maximum(self.farthest, far) if len(self.farthest) else far
        self.last = float(block.t[-1])
        if self._per_current is not None:
            block = replace(block, signals=block.signals | {"i": block.signals["i"] / self._per_current})
        return block
