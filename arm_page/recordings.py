"""The recordings of a folder, and their contents."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import DeviceFault, InputError
from daq.recording import ledger_table, open_long

Table = dict[str, Any]
MOST = 200
DRAWN = 400
"""Number of intervals in which currents and positions of a recording are drawn."""
SUFFIX = ".mcap"


class Recordings:
    """Recordings ``*.mcap`` of one folder, by file name; what was read is cached until the file changes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self._read: dict[tuple[str, int, int], Table] = {}

    def follow(self, folder: str | None) -> None:
        """Uses the folder into which the daemon records, if it is on this machine."""
        if folder is not None and Path(folder).is_dir():
            self.folder = Path(folder)

    def new(self, experiment: str) -> Path:
        """Path of a new recording that does not exist yet, from the experiment's name and the time."""
        plain = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in experiment)[:80] or "run"
        stem = f"{plain}_{time.strftime('%Y%m%d_%H%M%S')}"
        names = [f"{stem}{SUFFIX}", *(f"{stem}_{k}{SUFFIX}" for k in range(2, 100))]
        return next(path for name in names if not (path := self.folder / name).exists())

    def list(self) -> list[Table]:
        """The newest ``MOST`` recordings: name, bytes, time (s since the epoch)."""
        if not self.folder.is_dir():
            return []
        found = [(path.stat(), path.name) for path in self.folder.glob(f"*{SUFFIX}") if path.is_file()]
        found.sort(key=lambda entry: -entry[0].st_mtime)
        return [{"name": name, "bytes": status.st_size, "time": status.st_mtime} for status, name in found[:MOST]]

    def path(self, name: str) -> Path:
        """Path of a recording. InputError unless ``name`` is a recording of this folder."""
        path = self.folder / name
        if Path(name).name != name or not name.endswith(SUFFIX) or not path.is_file():
            raise InputError(name, "is no recording of this page; reload the list")
        return path

    def details(self, name: str) -> Table:
        """How a run ended, its contents, its losses; and its positions and currents, thinned for a picture."""
        path = self.path(name)
        status = path.stat()
        key = (name, status.st_size, status.st_mtime_ns)
        if key not in self._read:
            self._read = {k: table for k, table in self._read.items() if k[0] != name}
            self._read[key] = _details(path)
        return self._read[key]


def _details(path: Path) -> Table:
    try:
        recording = open_long(path, damaged=True)
    except DeviceFault as fault:
        raise InputError(path.name, fault.what) from None
    run = recording.run or {}
    return {
        "name": path.name,
        "file": str(path),
        "experiment": (recording.experiment or {}).get("name"),
        "rig": recording.rig.get("name"),
        "rows": len(recording),
        "duration": recording.duration,
        "finished": recording.finished,
        "notes": [*recording.notes, *run.get("notes", [])],
        "ending": run.get("ending"),
        "ledger": ledger_table(recording.ledger),
        "clocks": [_clock(fit) for fit in run.get("clocks", [])],
        "made": recording.provenance.get("made"),
        "has_model": recording.model is not None,
        "has_points": bool(recording.layout.points),
        "joints": list(recording.layout.joints),
        "drawn": _drawn(recording),
    }


def _clock(fit: Table) -> Table:
    return {
        "device": fit["device"],
        "tick_rate": fit["tick_rate"],
        "residual_us": fit["residual_rms_ns"] * 1e-3,
        "std_us": max(fit["std_ns"]) * 1e-3,
        "readings": fit["pairs"],
    }


def _drawn(recording: Any) -> Table:
    """k intervals: t (k,) s; (J, k): q, d newest position and demand; lo, hi, i lowest, highest, mean current."""
    if not len(recording):
        return {"t": [], "q": [], "d": [], "lo": [], "hi": [], "i": []}
    width = max(recording.duration / DRAWN, 1e-9)
    joints = recording.joints
    q, demand = np.full((2, DRAWN + 1, joints), np.nan)
    total, count = np.zeros((2, DRAWN + 1, joints))
    low, high = np.full((DRAWN + 1, joints), np.inf), np.full((DRAWN + 1, joints), -np.inf)
    for block in recording.blocks():
        bins = np.minimum((block.t / width).astype(np.int64), DRAWN)
        q[bins] = block.q
        if block.qref is not None:
            demand[bins] = block.qref
        np.add.at(total, bins, np.nan_to_num(block.i))
        np.add.at(count, bins, ~np.isnan(block.i))
        np.minimum.at(low, bins, np.where(np.isnan(block.i), np.inf, block.i))
        np.maximum.at(high, bins, np.where(np.isnan(block.i), -np.inf, block.i))
    t = (np.arange(DRAWN + 1) + 0.5) * width
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    columns = {"q": q, "d": demand, "lo": low, "hi": high, "i": mean}
    return {"t": np.round(t, 4).tolist()} | {name: _plain(values, 5) for name, values in columns.items()}


def _plain(values: Any, digits: int) -> list[list[float | None]]:
    return [[round(v, digits) if np.isfinite(v) else None for v in column] for column in values.T.tolist()]
