"""A recording read back: numpy arrays by joint in SI units, raw counts and volts, and everything it was recorded with."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError, toml_of
from arm_io.types import Array
from daq.acquisition.ledger import LedgerSummary
from daq.recording.contents import Contents, read_contents
from daq.recording.losses import Account, opened
from daq.recording.messages.row_format import JOINT_TOPICS, Layout
from drivers.protocols import Quality

PAUSE = 10.0
"""Median periods; jitter of a working acquisition stays below."""


@dataclass(frozen=True)
class Gap:
    """Between rows ``row`` and ``row + 1`` (from 0) ``triggers`` rows are known to be missing; ``seconds`` lie between them."""

    row: int
    triggers: int
    seconds: float


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """n rows of J joints. Missing samples are NaN; what a recording does not have at all is None.

    path        the file
    layout      its columns; ``layout.raw`` tells a recording of devices from an imported or simulated one
    t           (n,) s since the first row, acquisition time
    wall_ns     (n,) wall time of the rows; number: (n,) of their triggers
    q, i        (n, J) rad (m), motor encoder over gear ratio; (n, J) A, positive drives the joint positive
    qref        (n, J) rad (m) demanded; ql: (n, J) rad (m) link-side encoder; v: (n, J) motor V; temp: (n, J) degC
    xyz         (n, 3) m tracker's target in the base frame; points: (n, 3) m in the tracker's own frame
    counts      (n, C) int64; volts: (n, A) V; quality: (n, C + A + tracker) uint8, see drivers.protocols.Quality
    host_ns     (n,) host's monotonic clock; tick: (n,) of the clock device
    time        (n,) s as in the table that was imported (or simulated)
    extra       further columns of a table by name, (n,)
    rig, experiment  tables of the TOML files; model: its TOML text
    calibration, provenance  as recorded
    attachments every attachment by file name
    ledger      triggers = rows here + rows lost, each loss with its reason
    gaps        where triggers are missing between rows, or more than ``PAUSE`` median periods pass (also in a table)
    finished    False: the recording was cut off
    notes       sentences about what is wrong with the file; empty for a whole one
    averaged    rows of the file that each row here is the mean of (``open_recording`` with ``most_numbers``)
    """

    path: Path
    layout: Layout
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
    attachments: dict[str, bytes]
    ledger: LedgerSummary
    gaps: list[Gap]
    finished: bool
    notes: tuple[str, ...]
    averaged: int = 1

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        seconds = float(self.t[-1]) if len(self) else 0.0
        lost = f", {self.ledger.lost} rows lost" if self.ledger.lost else ""
        return f"<Recording {self.path.name}: {len(self)} rows of {self.joints} joints, {seconds:.3f} s{lost}>"

    @property
    def joints(self) -> int:
        """J."""
        return len(self.layout.joints)

    @property
    def dt(self) -> float:
        """Median period, s; NaN with fewer than two rows."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else float("nan")

    @property
    def rig(self) -> dict[str, Any]:
        return self._toml("rig.toml") or {}

    @property
    def model(self) -> str | None:
        data = self.attachments.get("model.toml")
        return None if data is None else data.decode()

    @property
    def experiment(self) -> dict[str, Any] | None:
        return self._toml("experiment.toml")

    @property
    def calibration(self) -> dict[str, Any] | None:
        data = self.attachments.get("calibration.json")
        return None if data is None else json.loads(data)

    @property
    def provenance(self) -> dict[str, Any]:
        return json.loads(self.attachments.get("provenance.json", b"{}"))

    @property
    def run(self) -> dict[str, Any] | None:
        """How the run ended, its notes and clocks, of a measured recording."""
        data = self.attachments.get("run.json")
        return None if data is None else json.loads(data)

    def doubted(self, signal: Literal["q", "i", "points"]) -> dict[str, NDArray[np.bool_]]:
        """What the instruments themselves doubted: name of a ``drivers.protocols.Quality`` in small letters -> rows (n, J), points (n, 1).

        Only doubts that occur; none in a recording without devices.
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
        return {str(doubt.name).lower(): rows for doubt in Quality if (rows := (bits & doubt) != 0).any()}

    def _toml(self, name: str) -> dict[str, Any] | None:
        data = self.attachments.get(name)
        return None if data is None else toml_of(data.decode(), f"{self.path}: {name}")


def open_recording(path: str | Path, *, damaged: bool = False, most_numbers: int | None = None) -> Recording:
    """Reads a recording, finished or cut off (``RUN.mcap.active``); of the latter the ledger tells what is missing.

    damaged  True: of a damaged file everything that can be read, with ``notes``; False: it is refused, so that nobody
             computes with holes unawares
    most_numbers  rows times joints to be kept of each signal: in a longer recording rows are averaged, and raw counts, volts and clocks
             left out (``daq.recording.thinned``); None: everything as it was recorded
    Raises InputError where the file is absent, no recording of armscope, or damaged.
    """
    path = Path(path)
    contents = read_contents(path, most_numbers=most_numbers)
    if contents.damages and not damaged:
        raise InputError(path, f"is damaged: {contents.damages[0].sentence}; 'armscope recover' keeps what can be read")
    recording = recording_of(path, contents)
    opened(Account(path, recording.ledger, recording.notes))
    return recording


def recording_of(path: Path, contents: Contents) -> Recording:
    """The recording that the contents of a file make."""
    columns: dict[str, Any] = contents.arrays()
    layout, wall_ns, number = contents.layout, columns["wall_ns"], columns["number"]
    ledger, sure = contents.ledger()
    averaged = 1 if contents.thinned is None else contents.thinned.factor
    t = (wall_ns - wall_ns[:1]) * 1e-9 if layout.raw else columns["time"] - columns["time"][:1]
    signals: dict[str, Any] = {name: _by_joint(columns.get(name), layout, name) for name in JOINT_TOPICS}
    for name in ("q", "i"):
        signals[name] = np.full((len(t), len(layout.joints)), np.nan) if signals[name] is None else signals[name]
    recording = Recording(
        path=path,
        layout=layout,
        t=t,
        wall_ns=wall_ns,
        number=number,
        **signals,
        xyz=columns.get("xyz") if layout.points == "base" else None,
        points=columns.get("xyz") if layout.points == "tracker" else None,
        counts=columns.get("counts"),
        volts=columns.get("volts"),
        quality=columns.get("quality"),
        host_ns=columns.get("host_ns"),
        tick=columns.get("tick"),
        time=columns.get("time"),
        extra=dict(zip(layout.extra, columns["extra"].T)) if "extra" in columns else {},
        attachments=contents.attachments,
        ledger=ledger,
        gaps=_gaps(number, t, averaged),
        finished=contents.finished,
        notes=contents.notes(sure),
        averaged=averaged,
    )
    return _in_base_frame(recording)


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


def _in_base_frame(recording: Recording) -> Recording:
    """With ``xyz`` where the rig knows how the tracker stands to the base."""
    pose = recording.rig.get("tracker", {}).get("base_from_tracker")
    if recording.points is None or pose is None:
        return recording
    base_from_tracker = np.array(pose, float)
    return replace(recording, xyz=recording.points @ base_from_tracker[:3, :3].T + base_from_tracker[:3, 3])
