"""Converts rows to frames, which are drawn 50 times per second of acquisition time and include every current peak."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array

FRAME_NS = 20_000_000
KEPT_SECONDS = 30.0
KEPT = round(KEPT_SECONDS * 1e9 / FRAME_NS)


@dataclass
class Frame:
    """Rows of one interval of ``FRAME_NS``.

    t           s, time of the newest row since the first received row of the run
    rows        number of rows
    q, demand   (J,) rad (m) of the newest row that has a value; NaN: no row has
    low, high   (J,) A: lowest and highest current; mean: the average
    point       (3,) m, newest tracker point in the base frame; NaN if the tracker's frame is not known
    """

    bin: int
    t: float
    rows: int
    q: Array
    demand: Array
    low: Array
    high: Array
    mean: Array
    point: Array
    _sum: Array = field(default_factory=lambda: np.zeros(0))
    _count: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def merge(self, later: Frame) -> None:
        """Adds later rows of the same interval."""
        self.t, self.rows = later.t, self.rows + later.rows
        self.q = np.where(np.isnan(later.q), self.q, later.q)
        self.demand = np.where(np.isnan(later.demand), self.demand, later.demand)
        self.point = np.where(np.isnan(later.point), self.point, later.point)
        self.low, self.high = np.fmin(self.low, later.low), np.fmax(self.high, later.high)
        self._sum, self._count = self._sum + later._sum, self._count + later._count
        self.mean = _mean(self._sum, self._count)

    def as_json(self) -> str:
        """The frame as one JSON object; missing values are null."""
        table: dict[str, Any] = {"t": round(self.t, 4), "n": self.rows}
        for name, values, digits in (
            ("q", self.q, 5),
            ("d", self.demand, 5),
            ("lo", self.low, 4),
            ("hi", self.high, 4),
            ("i", self.mean, 4),
            ("p", self.point, 6),
        ):
            table[name] = _plain(values, digits)
        return json.dumps(table, separators=(",", ":"))


class FrameMaker:
    """Makes the frames of successive runs; ``base_from_tracker`` (4, 4); None: unknown, and frames have no point."""

    def __init__(self, joints: int, base_from_tracker: Sequence[Sequence[float]] | None) -> None:
        self._joints = joints
        self._pose = None if base_from_tracker is None else np.array(base_from_tracker, float)
        self._run = ""
        self._origin: int | None = None
        self._open: Frame | None = None

    def add(self, run: str, columns: Mapping[str, NDArray]) -> list[Frame]:
        """Adds the rows of a block of run ``run``; returns the frames that are complete with them."""
        host = columns["host_ns"]
        done: list[Frame] = []
        if run != self._run:
            done = self.end()
            self._run, self._origin = run, None
        if not len(host):
            return done
        if self._origin is None:
            self._origin = int(host[0])
        bins = (host - self._origin) // FRAME_NS
        edges = [0, *(np.flatnonzero(np.diff(bins)) + 1).tolist(), len(bins)]
        for first, last in pairwise(edges):
            frame = self._frame(int(bins[first]), self._origin, slice(first, last), columns)
            if self._open is not None and self._open.bin == frame.bin:
                self._open.merge(frame)
                continue
            done += self.end()
            self._open = frame
        return done

    def end(self) -> list[Frame]:
        """The incomplete frame at the end of a run, if there is one."""
        frame, self._open = self._open, None
        return [] if frame is None else [frame]

    def _frame(self, number: int, origin: int, rows: slice, columns: Mapping[str, NDArray]) -> Frame:
        current = columns["i"][rows] if "i" in columns else np.full((1, self._joints), np.nan)
        there = ~np.isnan(current)
        total, count = np.where(there, current, 0.0).sum(axis=0), there.sum(axis=0)
        low = np.where(count, np.where(there, current, np.inf).min(axis=0), np.nan)
        high = np.where(count, np.where(there, current, -np.inf).max(axis=0), np.nan)
        return Frame(
            bin=number,
            t=(int(columns["host_ns"][rows][-1]) - origin) * 1e-9,
            rows=rows.stop - rows.start,
            q=self._newest(columns, "q", rows),
            demand=self._newest(columns, "qref", rows),
            low=low,
            high=high,
            mean=_mean(total, count),
            point=self._point(columns, rows),
            _sum=total,
            _count=count,
        )

    def _newest(self, columns: Mapping[str, NDArray], name: str, rows: slice) -> Array:
        if name not in columns:
            return np.full(self._joints, np.nan)
        values = columns[name][rows]
        if not np.isnan(values[-1]).any():
            return np.array(values[-1], float)
        last = len(values) - 1 - np.argmax(~np.isnan(values[::-1]), axis=0)
        return np.array(values[last, np.arange(values.shape[1])], float)

    def _point(self, columns: Mapping[str, NDArray], rows: slice) -> Array:
        if "xyz" in columns:
            points, pose = columns["xyz"][rows], np.eye(4)
        elif "points" in columns and self._pose is not None:
            points, pose = columns["points"][rows], self._pose
        else:
            return np.full(3, np.nan)
        seen = np.flatnonzero(~np.isnan(points[:, 0]))
        return np.full(3, np.nan) if not len(seen) else np.asarray(pose[:3, :3] @ points[seen[-1]] + pose[:3, 3])


class Ring:
    """The frames of the last 30 s, numbered from 1 without gaps; written by one thread, read by any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: deque[str] = deque(maxlen=KEPT)
        self.run = ""
        self.last = 0

    def put(self, run: str, frames: Sequence[Frame]) -> None:
        """Appends frames of a run; a new run begins empty."""
        encoded = [frame.as_json() for frame in frames]
        with self._lock:
            if run != self.run:
                self.run = run
                self._frames.clear()
            self._frames.extend(encoded)
            self.last += len(encoded)

    def since(self, number: int) -> tuple[str, int, list[str]]:
        """The run, the number of the last frame, and the stored frames after frame ``number``."""
        with self._lock:
            count = min(self.last - number, len(self._frames))
            return self.run, self.last, list(islice(self._frames, len(self._frames) - count, None))


def _mean(total: Array, count: NDArray[np.int64]) -> Array:
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _plain(values: Array, digits: int) -> list[float | None] | None:
    """Rounded numbers; None for each NaN, and for the whole list if all are NaN."""
    numbers = [round(value, digits) if np.isfinite(value) else None for value in values.tolist()]
    return None if all(number is None for number in numbers) else numbers
