"""Measured data from elsewhere in, a recording out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict, Unpack
from warnings import warn

import numpy as np

from arm_io import InputError, counted
from arm_io.dates import utc_date_of
from arm_io.progress import silent
from arm_io.toml import check_table
from arm_io.types import Array
from armscope.api.import_attachments import attachments_of
from armscope.api.reading import File
from daq.recording import Table, TimeUnit, write_blocks
from daq.recording.tables import Mapping as Columns
from daq.recording.tables import first_names, guessed, open_source, read_blocks, read_mapping
from daq.rig import LONGEST_RIG_NAME, read_rig

if TYPE_CHECKING:
    import pandas

    from daq.recording import Recording
    from daq.rig import Rig

Accept: TypeAlias = Callable[[Path, Columns], bool]


@dataclass(frozen=True, kw_only=True)
class Imported:
    """What an import wrote: the file, rows, joints, duration s, rows with missing samples.

    cut      whether a part of a bag was cut off, so that what came after it is lost
    mapping  how the columns were read; None: they have armscope's names
    """

    path: Path
    rows: int
    joints: int
    seconds: float
    missing: int
    cut: bool
    mapping: Columns | None


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a table is read: as the options of ``armscope import``.

    rig, model      file with the joints (one of the two); None: joints from the columns
    mapping         names and units of the columns; None: armscope's own, or those that the table suggests
    keep_extra      keep columns with unknown names
    time_unit       of the column t, where its values do not look like s
    topic           of a bag: of the joints
    recorded_times  of a bag: the times of recording instead of the stamps
    date            when a table without dates was recorded, UTC; None: now
    """

    rig: Path | None = None
    model: Path | None = None
    mapping: Columns | None = None
    keep_extra: bool = False
    time_unit: TimeUnit | None = None
    topic: str | None = None
    recorded_times: bool = False
    date: str | None = None


class Details(TypedDict, total=False):
    """The options of ``import_table`` that few tables need, as of ``Reading``."""

    keep_extra: bool
    time_unit: TimeUnit | None
    topic: str | None
    recorded_times: bool
    date: str | None


def import_table(
    table: File | pandas.DataFrame,
    out: File,
    *,
    rig: File | None = None,
    model: File | None = None,
    mapping: File | Mapping[str, Any] | None = None,
    guess: bool = False,
    **details: Unpack[Details],
) -> Recording:
    """Measured data as a recording: a CSV, Parquet, .mat or HDF5 file, a ROS 2 bag, or a table of pandas.

    table       columns t (s), q1.., i1.. and others as docs/recordings.md lists them, or other names with a ``mapping``
                or a ``guess``; of pandas, t may be the index
    out         the recording to write (.mcap); of existing files only an imported or simulated one is replaced
    rig, model  file with the joints (one of the two); None: joints from the columns
    mapping     path of a mapping, or its content: {"columns": {"t": "time", "q": "pos_{0}"}, "units": {"q": "deg"}}
    guess       accept the mapping that the names of the columns suggest
    details     keep_extra (bool): keep columns with unknown names. time_unit: "s", "ms", "us" or "ns". date: when a
                table without dates was recorded, UTC. Of a bag: topic of the joints; recorded_times (bool)
    What a reader should know, such as columns left out, is given as Python warnings. Raises InputError where the table
    cannot be used; nothing is written then.
    """
    from armscope.api.reading import open_recording

    reading = Reading(
        rig=None if rig is None else Path(rig),
        model=None if model is None else Path(model),
        mapping=_columns(mapping),
        **details,
    )
    with TemporaryDirectory() as folder:
        file = _as_file(table, Path(folder))
        given = str(file) if file.parent != Path(folder) else "the table of pandas"
        try:
            write_import(
                file,
                Path(out),
                reading,
                accept=lambda *_: guess,
                say=lambda line: warn(line.replace(str(file), given), stacklevel=4),
            )
        except InputError as error:
            raise InputError(str(error.where).replace(str(file), given), error.what) from None
    return open_recording(out)


def _columns(mapping: File | Mapping[str, Any] | None) -> Columns | None:
    if mapping is None:
        return None
    return (
        check_table("mapping", dict(mapping), Columns) if isinstance(mapping, Mapping) else read_mapping(Path(mapping))
    )


def _as_file(table: File | pandas.DataFrame, folder: Path) -> Path:
    """The path of a table; a table of pandas as a CSV file in ``folder``. InputError for anything else."""
    if isinstance(table, str | PathLike):
        return Path(table)
    if not hasattr(table, "to_csv"):
        raise InputError("a table", f"must be a path or a table of pandas (is {type(table).__name__})")
    file = folder / "pandas.csv"
    (table if table.index.name is None else table.reset_index()).to_csv(file, index=False)
    return file


def write_import(
    table: Path,
    out: Path,
    reading: Reading,
    *,
    accept: Accept,
    save: Callable[[Columns | None], None] = silent,
    say: Callable[[str], None],
) -> Imported:
    """Writes a table as a recording.

    accept  asked whether the mapping that a table suggests is right; False: InputError
    save    called with the mapping before anything is written
    say     called with each note
    InputError where the table cannot be used.
    """
    when = _date(reading.date)
    checked = _joints_of(reading.rig, reading.model)
    names = [] if checked is None else [joint.name or f"joint{number}" for number, joint in enumerate(checked.joint, 1)]
    chosen = _guessed(table, accept, names) if reading.mapping is None else reading.mapping
    source = open_source(table, mapping=chosen, topic=reading.topic, joints=names, recorded=reading.recorded_times)
    others = [] if chosen is None or reading.keep_extra else chosen.left_out(source)
    chosen = chosen or source.mapping
    if chosen is not None and reading.mapping is None:
        say(f"{table}: {chosen.in_words()}")
    if chosen is not None and "%" in chosen.units_of("i", 1):
        say(
            f"{table}: i is in % of what each drive calls 100 %, and torque_constant counts per %. If you know the "
            'current at 100 %, import it with a mapping (--map) that says i = "A" under [units] and i = [A per %, one '
            "for each joint] under [scale]"
        )
    if others:
        say(f"{table}: {counted(len(others), 'column')} left out: {first_names(others)}")
    joints = None if checked is None else checked.joints
    torques = chosen is not None and chosen.torques
    per_current = _torque_per_current(checked) if torques else None
    blocks = _Blocks(
        read_blocks(source, joints=joints, keep_extra=reading.keep_extra, unit=reading.time_unit, mapping=chosen),
        per_current,
    )
    first = next(blocks)
    save(chosen)
    if when and first.epoch is not None:
        raise InputError("--date", f"is for a table without dates; {table} has the dates of its rows")
    attachments = attachments_of(table, reading.rig, checked, first, chosen, per_current)
    attachments.provenance.update(when)
    effort = (per_current or [1.0] * first.joints) if torques else ()
    named: Sequence[str] = names or getattr(source, "joints", ())
    write_blocks(out, first, blocks, attachments, joints=named, effort=effort)
    for note in getattr(source, "notes", list)():
        say(f"{table}: {note}")
    if chosen is None or "q" not in chosen.units:
        _doubt_radians(out, blocks.farthest, checked, say)
    return Imported(
        path=out,
        rows=blocks.rows,
        joints=first.joints,
        seconds=blocks.last - float(first.t[0]),
        missing=blocks.missing,
        cut=getattr(source, "cut", False),
        mapping=chosen,
    )


def _guessed(table: Path, accept: Accept, joints: Sequence[str]) -> Columns | None:
    """The mapping that a table suggests, if it is accepted; None where it needs none. InputError: not accepted."""
    found = guessed(table, joints)
    if found is None or accept(table, found):
        return found
    raise InputError(
        table,
        f"has other columns than t, q1, i1, .. (joints count from 1); it seems to mean {found.in_words()}: --guess "
        "accepts this, --map takes a file",
    )


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


def _doubt_radians(out: Path, farthest: Array, rig: Rig | None, say: Callable[[str], None]) -> None:
    """A note where a joint that turns goes beyond two turns, and the unit is not stated to be rad."""
    turning = [rig is None or rig.joint[j].unit == "rad" for j in range(len(farthest))]
    wide = [j for j, angle in enumerate(farthest) if turning[j] and angle > 4 * math.pi]
    if wide:
        say(
            f"{out}: joint {wide[0] + 1} reaches {farthest[wide[0]]:.4g} rad, more than two turns; if the table "
            'has degrees, import it with a mapping that says q = "deg" under [units] (--map)'
        )


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


def _torque_per_current(rig: Rig | None) -> list[float] | None:
    """N m/A (N/A) of each joint by the rig's model; None where it states no motors, and torques stay torques."""
    from arm_model import read_model

    if rig is None or rig.model_path is None:
        return None
    constants = [joint.drive_constant for joint in read_model(rig.model_path).joints]
    return None if all(constant == 1.0 for constant in constants) else constants
