"""A recording read back.

Numpy arrays by joint in SI units, raw counts and volts, and everything it was recorded with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError, counted
from arm_io.types import Array
from daq.recording.contents import AllRows, Columns, Contents, read_contents
from daq.recording.head import RecordingHead
from daq.recording.losses import Account, opened
from daq.recording.messages.row_format import JOINT_TOPICS, Layout
from daq.recording.thinned import Thinned
from drivers.protocols import Quality

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

PAUSE = 10.0
"""Median periods; jitter of a working acquisition stays below."""


@dataclass(frozen=True)
class Gap:
    """A gap of ``seconds`` between rows ``row`` and ``row + 1`` (from 0), in which ``triggers`` rows are missing."""

    row: int
    triggers: int
    seconds: float


@dataclass(frozen=True, eq=False, repr=False)
class Recording(RecordingHead):
    """n rows of J joints. Missing samples are NaN; what a recording does not have at all is None.

    path, layout, attachments, ledger, finished, notes, rig, experiment, model, calibration, provenance  as
        ``RecordingHead`` has them
    t           (n,) s since the first row, acquisition time
    wall_ns     (n,) wall time of the rows; number: (n,) of their triggers
    q, i        (n, J) rad (m), motor encoder over gear ratio; (n, J) A, positive drives the joint positive
    qref        (n, J) rad (m) demanded; ql: (n, J) rad (m) link-side encoder; v: (n, J) motor V; temp: (n, J) degC
    xyz         (n, 3) m tracker's target in the base frame; points: (n, 3) m in the tracker's own frame
    counts      (n, C) int64; volts: (n, A) V; quality: (n, C + A + tracker) uint8, see drivers.protocols.Quality
    host_ns     (n,) host's monotonic clock; tick: (n,) of the clock device
    time        (n,) s as in the table that was imported (or simulated)
    extra       further columns of a table by name, (n,)
    gaps        where triggers are missing between rows, or more than ``PAUSE`` median periods pass (also in a table)
    averaged    rows of the file that each row here is the mean of (``open_recording`` with ``most_numbers``)
    """

    t: Array
    wall_ns: NDArray[np.int64]
    number: NDArray[np.int64]
    q: Array
    i: Array
    qref: Array | None
    ql: Array | None
    v: Array | None
    temp: Array | None
    xyz: Array | None
    points: Array | None
    counts: NDArray[np.int64] | None
    volts: Array | None
    quality: NDArray[np.uint8] | None
    host_ns: NDArray[np.int64] | None
    tick: NDArray[np.int64] | None
    time: Array | None
    extra: dict[str, Array]
    gaps: list[Gap]
    averaged: int = 1

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        seconds = float(self.t[-1]) if len(self) else 0.0
        lost = f", {self.ledger.lost} rows lost" if self.ledger.lost else ""
        return (
            f"<Recording {self.path.name}: {len(self)} rows of {counted(self.joints, 'joint')}, {seconds:.3f} s{lost}>"
        )

    def blocks(self) -> Iterator[Recording]:
        """All rows at once, as ``LongRecording`` has them block by block."""
        yield self

    @property
    def dt(self) -> float:
        """Median period, s; NaN with fewer than two rows."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else float("nan")

    @property
    def duration(self) -> float:
        """s, from the first row to the last; 0 without rows."""
        return float(self.t[-1]) if len(self.t) else 0.0

    @property
    def date(self) -> str | None:
        """Of the first row, '2026-11-22T09:30:00Z'; of an imported or simulated recording when it was made."""
        return self.date_at(self.wall_ns)

    def _repr_html_(self) -> str:
        from daq.recording.notebook import html

        return html(self)

    def plot(self) -> Figure:
        """Position, deviation from the demand, and current, joint by joint."""
        from daq.recording.plots import plot

        return plot([self])

    def to_pandas(self) -> pandas.DataFrame:
        """A table indexed by t (s), with the columns of ``armscope export`` and their units in ``attrs``."""
        from daq.recording.notebook import to_pandas

        return to_pandas(self)

    def to_xarray(self) -> xarray.Dataset:
        """Variables over time and joint, with units and the names of joints (``daq.recording.notebook``)."""
        from daq.recording.notebook import to_xarray

        return to_xarray(self)

    def flagged(self, signal: Literal["q", "i", "points"]) -> dict[str, NDArray[np.bool_]]:
        """Rows that the instruments flagged, by the name of the flag.

        The name is that of a ``drivers.protocols.Quality`` in lower case; the rows are a mask (n, J), of points (n, 1).

        Only flags that occur; none in a recording without devices.
        """
        if self.quality is None:
            return {}
        counters, inputs, table = len(self.layout.counters), len(self.layout.inputs), self.calibration or {}
        columns = {
            "q": list(table.get("count_column", ())),
            "i": [column + counters if column >= 0 else column for column in table.get("volt_column", ())],
            "points": [counters + inputs] if self.layout.points else [],
        }[signal]
        bits = np.zeros((len(self), len(columns)), np.uint8)
        for place, column in enumerate(columns):
            if column >= 0:
                bits[:, place] = self.quality[:, column]
        return {str(flag.name).lower(): rows for flag in Quality if (rows := (bits & flag) != 0).any()}


def open_recording(path: str | Path, *, damaged: bool = False, most_numbers: int | None = None) -> Recording:
    """Reads a recording, finished or cut off (``RUN.mcap.active``); of the latter the ledger lists what is missing.

    damaged  True: of a damaged file everything that can be read, with ``notes``; False: it is refused where more than
             chunks of rows is damaged (those are in the ledger), for what else was there is not known
    most_numbers  rows times joints to be kept of each signal: in a longer recording rows are averaged, and raw counts,
                  volts and clocks
             left out (``daq.recording.thinned``); None: everything as it was recorded
    Raises InputError where the file is absent, no recording of armscope, or damaged.
    """
    path = Path(path)
    contents, kept = read_contents(path, lambda layout: _sink(layout, most_numbers))
    head = head_of(path, contents, damaged=damaged)
    columns = kept.arrays()
    t = time_of(head.layout, columns, origin_of(head.layout, columns))
    recording = rows_of(head, columns, t, gaps=_gaps(columns["number"], t, kept.factor), averaged=kept.factor)
    return in_base_frame(recording, head.base_from_tracker)


def head_of(path: Path, contents: Contents, *, damaged: bool) -> RecordingHead:
    """The head of what was found, reported to every listener (``daq.recording.losses``).

    InputError where more of it is damaged than chunks of rows, and must not be.
    """
    harm = [damage for damage in contents.damages if not damage.rows]
    if harm and not damaged:
        raise InputError(path, f"is damaged: {harm[0].sentence}; 'armscope recover' keeps what can be read")
    ledger, sure = contents.ledger()
    notes = contents.notes(sure)
    head = RecordingHead(path, contents.layout, contents.attachments, ledger, contents.finished, notes)
    opened(Account(path, ledger, notes if head.fault is None else (*notes, head.fault)))
    return head


def _sink(layout: Layout, most_numbers: int | None) -> AllRows | Thinned:
    return AllRows() if most_numbers is None else Thinned(most_numbers // max(len(layout.joints), 1))


def origin_of(layout: Layout, columns: Columns) -> NDArray:
    """(1,) the time of the first row, or (0,) where there is none: ns of wall time, or s as in the table."""
    return columns["wall_ns" if layout.raw else "time"][:1].copy()


def time_of(layout: Layout, columns: Columns, origin: NDArray) -> Array:
    """(n,) s since ``origin``."""
    return (columns["wall_ns"] - origin) * 1e-9 if layout.raw else columns["time"] - origin


def rows_of(head: RecordingHead, columns: Columns, t: Array, *, gaps: list[Gap], averaged: int = 1) -> Recording:
    """A recording from some columns of a file, with rows at times ``t``.

    Tracker points stay in the frame of the file.
    """
    layout = head.layout
    signals: dict[str, Any] = {name: _by_joint(columns.get(name), layout, name) for name in JOINT_TOPICS}
    for name in ("q", "i"):
        signals[name] = np.full((len(t), len(layout.joints)), np.nan) if signals[name] is None else signals[name]
    others: dict[str, Any] = {
        name: columns.get(name) for name in ("counts", "volts", "quality", "host_ns", "tick", "time")
    }
    return Recording(
        **{item.name: getattr(head, item.name) for item in fields(RecordingHead)},
        **signals,
        **others,
        t=t,
        wall_ns=columns["wall_ns"],
        number=columns["number"],
        xyz=columns.get("xyz") if layout.points == "base" else None,
        points=columns.get("xyz") if layout.points == "tracker" else None,
        extra=dict(zip(layout.extra, columns["extra"].T)) if "extra" in columns else {},
        gaps=gaps,
        averaged=averaged,
    )


def _by_joint(values: Array | None, layout: Layout, signal: str) -> Array | None:
    """(n, J), NaN for joints that do not have the signal."""
    if values is None or len(layout.signals[signal]) == len(layout.joints):
        return values
    full = np.full((len(values), len(layout.joints)), np.nan)
    full[:, np.array(layout.signals[signal]) - 1] = values
    return full


def _gaps(number: NDArray[np.int64], t: Array, averaged: int) -> list[Gap]:
    if len(t) < 2:
        return []
    steps, pauses = np.diff(number), np.diff(t)
    places = np.flatnonzero((steps != averaged) | (pauses > PAUSE * np.median(pauses)))
    return [Gap(int(row), int(steps[row]) - averaged, float(pauses[row])) for row in places]


def in_base_frame(recording: Recording, base_from_tracker: Array | None) -> Recording:
    """With ``xyz`` where the tracker's pose is known."""
    if recording.points is None or base_from_tracker is None:
        return recording
    return replace(recording, xyz=recording.points @ base_from_tracker[:3, :3].T + base_from_tracker[:3, 3])
