"""Tables from any source of columns (CSV, Parquet, MATLAB, ROS bags), some rows at a time, under our names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Protocol, overload

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.progress import report
from arm_io.types import Array
from daq.recording.messages.row_format import JOINT_TOPICS, POSE_COLUMNS
from daq.recording.tables.csv_header import JOINT_COLUMN, joints_of
from daq.recording.tables.csv_time import TimeColumn, TimeUnit, ask_of_speeds
from daq.recording.tables.mapping import Mapping, Picked

_LARGEST = 1e15
"""In rad, m, A, V or degC: nothing measures more, and squares of it are still numbers."""


@dataclass(frozen=True)
class Table:
    """n rows, all of a file or some. Missing samples are NaN.

    t        (n,) s, strictly increasing; from 0 on where the file's times are of the epoch
    signals  'q', 'i', and whatever else of ``JOINT_TOPICS`` some joint has -> (n, J)
    having   the same signals -> joints with a column, numbered from 1
    xyz      (n, 3) m in the base frame, or None
    extra    further columns by name, (n,)
    epoch    s since 1970 of the file's first row, exactly, or None; start_ns: the same in ns, where ROS stamps can
             hold it
    """

    t: Array
    signals: dict[str, Array]
    having: dict[str, tuple[int, ...]]
    xyz: Array | None
    extra: dict[str, Array]
    epoch: Decimal | None = None
    start_ns: int | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def joints(self) -> int:
        """J."""
        return self.signals["q"].shape[1]

    @property
    def has_pose(self) -> bool:
        """Whether the further columns are the pose of a floating base, among others."""
        return set(POSE_COLUMNS) <= set(self.extra)

    @property
    def rows_with_missing_samples(self) -> int:
        """Rows in which a column has no value."""
        holes = [np.isnan(values[:, np.array(self.having[name]) - 1]) for name, values in self.signals.items()]
        holes += [] if self.xyz is None else [np.isnan(self.xyz)]
        return int(np.any([hole.any(axis=1) for hole in holes], axis=0).sum())


@dataclass(frozen=True)
class Chunk:
    """Some rows of a source.

    places   their numbers, as a person finds them in the file
    columns  name in the file -> (n,) numbers, NaN where there is none
    times    texts of the column of times, exactly as the file has them
    """

    places: Sequence[int]
    columns: dict[str, Array]
    times: Sequence[str]


class Source(Protocol):
    """A file with columns.

    word     what a row is called in messages: 'line' or 'row'
    where    of its names in messages: 'line 1: ', or '' where they stand on no line
    names    of its columns
    mapping  which column is which, where the format itself says it
    rows     how many there are; None: unknown before they are read
    """

    path: Path
    word: str
    where: str

    @property
    def names(self) -> Sequence[str]: ...
    @property
    def mapping(self) -> Mapping | None: ...
    @property
    def rows(self) -> int | None: ...
    def chunks(self, needed: Sequence[str], time: str) -> Iterator[Chunk]:
        """All rows in their order, with the columns ``needed``; ``time`` is one of them."""
        ...

    def last_time(self, time: str) -> str:
        """Text of the last row's time; "" where it is unknown."""
        ...

    def unit_of(self, time: str) -> TimeUnit | None:
        """The unit of a column of times, where the file itself says it."""
        ...


class Exact(Sequence[str]):
    """Numbers (n,) as the texts that read back as the same numbers, made when they are asked for."""

    def __init__(self, values: NDArray) -> None:
        self._values = values

    def __len__(self) -> int:
        return len(self._values)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> Exact: ...
    def __getitem__(self, place: int | slice) -> str | Exact:
        return Exact(self._values[place]) if isinstance(place, slice) else repr(self._values[place].item())


def read_blocks(
    source: Source,
    *,
    joints: int | None = None,
    keep_extra: bool = False,
    unit: TimeUnit | None = None,
    mapping: Mapping | None = None,
) -> Iterator[Table]:
    """The rows of a source, a bounded number at a time. InputError names row and column, and what would be right.

    joints   that the rig has; None: as many as the table has columns q1, q2, ...
    unit     of the column t, where the file does not say it itself; None: what ``mapping`` says, else s, and
             InputError where it looks like another
    mapping  which column is which; None: the columns have our names
    """
    path, rows = source.path, 0
    picked = [Picked(name, name) for name in source.names]
    if mapping is not None:
        picked = mapping.pick(source, keep_extra=keep_extra)
        unit = unit or mapping.time_unit
    try:
        count = joints_of(path, [one.name for one in picked], joints, keep_extra, source.where)
    except InputError as error:
        unread = getattr(source, "unread", "")
        raise InputError(error.where, f"{error.what}{unread and '; '}{unread}") from None
    time = next(one.column for one in picked if one.name == "t")
    unit = source.unit_of(time) or unit
    times = TimeColumn(path, unit, source.last_time(time), source.word)
    empty = {one.name for one in picked if JOINT_COLUMN.fullmatch(one.name)}
    for chunk in source.chunks([one.column for one in picked], time):
        if not len(chunk.places):
            continue
        t = times.seconds(chunk.places, chunk.times, chunk.columns[time])
        columns = {one.name: one.of(chunk.columns) for one in picked if one.name != "t"}
        _check_size(source, chunk.places, columns)
        empty = {name for name in empty if np.isnan(columns[name]).all()}
        table = _table(t, columns, count)
        if rows == 0 and unit is None:
            ask_of_speeds(path, t, table.signals["q"])
        rows += len(t)
        if source.rows:
            report("reading", rows, max(rows, source.rows))
        yield replace(table, epoch=times.epoch, start_ns=times.start_ns)
    if rows < 2:
        raise InputError(path, f"has {rows} {source.word}s of numbers; there must be at least 2")
    for one in picked:
        if one.name in empty:
            raise InputError(path, f"column {one.column} has no value in any {source.word}; omit it, or measure it")


def _table(t: Array, columns: dict[str, Array], joints: int) -> Table:
    """Columns by name in their places."""
    signals: dict[str, Array] = {}
    having: dict[str, tuple[int, ...]] = {}
    for name in JOINT_TOPICS:
        there = [joint for joint in range(1, joints + 1) if f"{name}{joint}" in columns]
        if there:
            having[name] = tuple(there)
            signals[name] = np.full((len(t), joints), np.nan)
            for joint in there:
                signals[name][:, joint - 1] = columns[f"{name}{joint}"]
    xyz = np.column_stack([columns[axis] for axis in "xyz"]) if "x" in columns else None
    known = {"x", "y", "z", *(f"{name}{joint}" for name, there in having.items() for joint in there)}
    return Table(t, signals, having, xyz, {name: values for name, values in columns.items() if name not in known})


def _check_size(source: Source, places: Sequence[int], columns: dict[str, Array]) -> None:
    for name, values in columns.items():
        if name not in "xyz" and not JOINT_COLUMN.fullmatch(name):
            continue
        if (wrong := ~(np.isnan(values) | (np.abs(values) <= _LARGEST))).any():
            row = int(np.argmax(wrong))
            raise InputError(
                source.path,
                f"{source.word} {places[row]}, column {name}: {values[row]:g} is not a measurement; a missing sample "
                "is an empty cell or NaN",
            )
