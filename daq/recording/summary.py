"""What is in a recording, as one table that becomes JSON or a page of text."""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.recording.blocks import LongRecording
from daq.recording.head import RecordingHead
from daq.recording.mcap_file.checksums import SENTENCES, verify
from daq.recording.mcap_file.pages import mapped
from daq.recording.messages.row_format import JOINT_TOPICS, format_of
from daq.recording.parts import ledger_table
from daq.recording.reader import PAUSE, Gap, Recording
from drivers.protocols import Quality

_UNITS = {"v": "V", "temp": "degC"}


def summary(recording: Recording | LongRecording) -> dict[str, Any]:
    """The table; numbers that do not exist are None. ``intervals`` and ``duration`` in s, ``rate`` in Hz (median)."""
    layout = recording.layout
    found = _Rows(recording.dt)
    for block in recording.blocks():
        found.add(block)
    return {
        "schema": "armscope.info/1",
        "file": str(recording.path),
        "bytes": recording.path.stat().st_size,
        "kind": recording.provenance.get("kind", "measured" if layout.raw else "table"),
        "finished": recording.finished,
        "notes": list(recording.notes),
        "rig": recording.rig.get("name"),
        "experiment": (recording.experiment or {}).get("name"),
        "run": recording.run,
        "rows": len(recording),
        "start": found.start if layout.raw else None,
        "duration": recording.duration,
        "rate": _number(1 / recording.dt),
        "intervals": {
            "min": _number(found.steps.low),
            "median": _number(recording.dt),
            "max": _number(found.steps.high),
        },
        "joints": list(layout.joints),
        "signals": _signals(recording, found),
        "counters": list(layout.counters),
        "inputs": list(layout.inputs),
        "extra": list(layout.extra),
        "quality_flags": found.flags,
        "topics": [{"topic": topic.name, "type": topic.type} for topic in format_of(layout.to_json()).topics],
        "ledger": ledger_table(recording.ledger),
        "gaps": [{"row": gap.row, "triggers": gap.triggers, "seconds": gap.seconds} for gap in found.gaps],
        "calibration": recording.calibration,
        "provenance": recording.provenance,
        "attachments": [
            {"name": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in recording.attachments.items()
        ],
    }


def verification_table(path: Path) -> dict[str, Any]:
    """What the checksums of a file say."""
    found = verify(mapped(path))
    return {
        "integrity": str(found.integrity),
        "sentence": SENTENCES[found.integrity],
        "records": found.records,
        "damages": [damage.sentence for damage in found.damages],
    }


class _Statistics:
    """Missing samples of one or several columns, and minimum, maximum and root mean square of the others."""

    def __init__(self) -> None:
        self.missing: Any = 0
        self.low: Any = math.inf
        self.high: Any = -math.inf
        self._squares: Any = 0.0
        self._count: Any = 0

    def add(self, values: NDArray[np.float64]) -> None:
        """Rows (n, ...) that follow."""
        there = ~np.isnan(values)
        self.missing = self.missing + (~there).sum(axis=0)
        self.low = np.minimum(self.low, np.where(there, values, np.inf).min(axis=0, initial=np.inf))
        self.high = np.maximum(self.high, np.where(there, values, -np.inf).max(axis=0, initial=-np.inf))
        self._squares = self._squares + (np.where(there, values, 0.0) ** 2).sum(axis=0)
        self._count = self._count + there.sum(axis=0)

    def column(self, k: int) -> dict[str, Any]:
        """As the table has them."""
        count = self._count[k]
        rms = math.sqrt(self._squares[k] / count) if count else math.nan
        numbers = {"min": self.low[k], "max": self.high[k], "rms": rms}
        return {"missing": int(self.missing[k])} | {name: _number(value) for name, value in numbers.items()}


class _Rows:
    """Statistics of the rows of a recording; ``period`` is the median time between them, s."""

    def __init__(self, period: float) -> None:
        self._pause = PAUSE * period
        self._row = 0
        self._number = np.empty(0, np.int64)
        self._t = np.empty(0)
        self.start: str | None = None
        self.steps = _Statistics()
        self.gaps: list[Gap] = []
        self.flags: dict[str, int] | None = None
        self.signals: dict[str, _Statistics] = defaultdict(_Statistics)

    def add(self, block: Recording) -> None:
        """The rows that follow."""
        if self.start is None and len(block):
            self.start = datetime.fromtimestamp(block.wall_ns[0] * 1e-9, UTC).isoformat(timespec="milliseconds")
        for name in (*JOINT_TOPICS, "points", "xyz"):
            values = getattr(block, name)
            if values is not None:
                self.signals[name].add(values)
        if block.quality is not None:
            self._doubt(block.quality)
        number, t = np.concatenate([self._number, block.number]), np.concatenate([self._t, block.t])
        steps, pauses = np.diff(number), np.diff(t)
        if len(pauses):
            self.steps.add(pauses)
        first = self._row - len(self._number)
        for place in np.flatnonzero((steps != 1) | (pauses > self._pause)):
            self.gaps.append(Gap(first + int(place), int(steps[place]) - 1, float(pauses[place])))
        self._row += len(block)
        self._number, self._t = number[-1:].copy(), t[-1:].copy()

    def _doubt(self, quality: NDArray[np.uint8]) -> None:
        """Number of values with each quality bit."""
        counts = self.flags or {}
        for bit in Quality:
            if bit and bit.name:
                name = bit.name.lower()
                counts[name] = counts.get(name, 0) + int(np.count_nonzero(quality & bit))
        self.flags = counts


def _signals(recording: RecordingHead, found: _Rows) -> list[dict[str, Any]]:
    """Statistics of each measured column, and its missing samples."""
    table = []
    for signal in JOINT_TOPICS:
        for joint in recording.layout.signals.get(signal, ()):
            if signal == "i":
                unit = recording.current_unit(joint)
            else:
                unit = _UNITS.get(signal) or recording.position_unit(joint)
            table.append({"signal": signal, "joint": joint, "unit": unit} | found.signals[signal].column(joint - 1))
    if recording.layout.points:
        points = found.signals["points" if recording.layout.points == "tracker" else "xyz"]
        frame = {"frame": recording.layout.points, "unit": "m"}
        table += [{"signal": axis, "joint": None} | frame | points.column(k) for k, axis in enumerate("xyz")]
    return table


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
