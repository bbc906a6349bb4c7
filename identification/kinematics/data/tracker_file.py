"""A tracker's own file, recorded during the run, assigned to the run's triggers.

The tracker makes one edge a sample; the run has one row an edge. Both lists are the same events, with members missing
on either side (a lost edge; samples that the tracker did not keep) and on two clocks. Equal counts alone prove nothing,
so the intervals are compared: jitter and pauses are a signature. The best start is where most intervals agree; from
there on, events are paired by time, with the clocks' drift followed.
"""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular
from arm_io.plain_data import LARGEST
from arm_io.types import Array
from identification.selection import MAD_TO_STD

_EVENTS = 2000
"""Rows and samples by which a start is judged, at most."""
_REACH = 30
"""Starts tried beyond the difference of the counts: both sides may have lost events."""


@dataclass(frozen=True)
class TrackerFile:
    """A tracker's file: t (n,) s on its own clock, xyz (n, 3) m in its own frame, NaN where the beam was broken."""

    name: str
    t: Array
    xyz: Array


@dataclass(frozen=True)
class Merge:
    """Which sample belongs to which row.

    sample    (rows,) int: index of the tracker's sample, -1 where there is none
    drift     tracker's seconds per run's second, less 1
    residual  s, robust deviation of the paired times after the clocks were fitted
    sure      False: the intervals fit more than one start (no jitter, no pause); the counts then decided
    """

    sample: Array
    drift: float
    residual: float
    sure: bool

    def points(self, tracker: TrackerFile) -> Array:
        """(rows, 3) m, NaN where there is no sample."""
        xyz = tracker.xyz[np.maximum(self.sample, 0)].copy()
        xyz[self.sample < 0] = np.nan
        return xyz


def read_tracker(path: str | Path) -> TrackerFile:
    """Reads a CSV file with columns t, x, y, z (s, m). Empty cells and nan are broken beams.

    InputError says what is wrong with the file.
    """
    try:
        with os.fdopen(open_regular(path), newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read as a CSV table: {getattr(error, 'strerror', None) or error}") from None
    head = [cell.strip() for cell in rows[0]] if rows else []
    missing = [name for name in ("t", "x", "y", "z") if name not in head]
    if missing:
        raise InputError(path, f"has no column {missing[0]!r}; the first row must name t, x, y, z")
    columns = [head.index(name) for name in ("t", "x", "y", "z")]
    table = np.full((len(rows) - 1, 4), np.nan)
    for number, row in enumerate(rows[1:], 2):
        for k, column in enumerate(columns):
            text = row[column].strip() if column < len(row) else ""
            if text and text.lower() != "nan":
                try:
                    table[number - 2, k] = float(text)
                except ValueError:
                    raise InputError(path, f"line {number}: {text!r} is no number") from None
                if not abs(table[number - 2, k]) <= LARGEST:
                    raise InputError(path, f"line {number}: {text!r} is no measurement; a broken beam is an empty cell")
    t = table[:, 0]
    if len(t) < 2 or not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        bad = 2 if len(t) < 2 else int(np.flatnonzero(~(np.diff(t) > 0))[0]) + 3 if not (np.diff(t) > 0).all() else 2
        raise InputError(path, f"line {bad}: column t must hold strictly increasing times, one per sample")
    return TrackerFile(Path(path).name, t, table[:, 1:])


def merge(rows_t: Array, tracker: TrackerFile) -> Merge:
    """Pairs the samples of a tracker's file with the rows of a run, whose acquisition times are ``rows_t`` (rows,) s.

    InputError where the two cannot belong together: no start makes their intervals agree.
    """
    a, b = np.asarray(rows_t, float), tracker.t
    period = float(np.median(np.diff(a)))
    theirs = float(np.median(np.diff(b)))
    if abs(theirs / period - 1.0) > 0.02:
        raise InputError(
            tracker.name,
            f"has a sample every {1e3 * theirs:.4g} ms, the run a row every {1e3 * period:.4g} ms: not the same "
            "triggers",
        )
    best, second = _starts(a, b, period)
    pairs = _pair(a, b, best.offset, best.drift, period)
    matched = int((pairs >= 0).sum())
    if matched < 0.5 * min(len(a), len(b)):
        raise InputError(
            tracker.name, f"only {matched} of {len(b)} samples fit to the run's {len(a)} triggers: not of this run"
        )
    sure = bool(second > 2.0 * best.cost + 1e-7)
    return Merge(pairs, best.drift, best.residual, sure)


def _starts(a: Array, b: Array, period: float) -> tuple[_Clocks, float]:
    """The best start, and the cost of the next best one.

    A start is which row the first sample belongs to, or which sample the first row: a shift by whole periods. Each is
    tried on up to ``_EVENTS`` events by pairing every row with the nearest sample and following the clocks.
    """
    reach = abs(len(a) - len(b)) + _REACH
    tried: list[_Clocks] = []
    for k in range(-reach, reach + 1):
        offset = b[0] - a[k] if 0 <= k < len(a) else (b[-k] - a[0] if 0 < -k < len(b) else None)
        fitted = None if offset is None else _follow(a, b, float(offset), period, 200)
        if fitted is not None:
            tried.append(fitted)
    close = min((f.cost for f in tried), default=0.0) * 3.0 + 1e-7
    longer = [_follow(a, b, f.offset, period, _EVENTS) for f in tried if f.cost <= close]
    final = sorted((f for f in longer if f is not None), key=lambda f: f.cost)
    if not final:
        raise InputError("tracker file", "its intervals agree with the run's triggers for no start")
    second = min((f.cost for f in tried + final if abs(f.offset - final[0].offset) > 0.5 * period), default=np.inf)
    return final[0], second


@dataclass(frozen=True)
class _Clocks:
    """The relation of two clocks from one start of the search: t_tracker = t + offset + drift (t - t0).

    It also has how well the pairs agree (s), and its cost, by which it is compared with other starts.
    """

    offset: float
    drift: float
    residual: float
    cost: float


def _follow(a: Array, b: Array, start: float, period: float, most: int) -> _Clocks | None:
    """The clocks from one start, in growing stretches; None where too few events pair."""
    offset, drift, n = start, 0.0, min(len(a), 50)
    while True:
        pairs = _pair(a[:n], b, offset, drift, period)
        rows = np.flatnonzero(pairs >= 0)
        if len(rows) < max(3, 0.4 * min(n, len(b))):
            return None
        x, y = a[rows] - a[0], b[pairs[rows]] - a[rows]
        keep = np.ones(len(x), bool)
        for _ in range(3):
            middle = float(x[keep].mean())
            spread = float(np.sum((x[keep] - middle) ** 2))
            drift = float(np.sum((x[keep] - middle) * y[keep])) / spread if spread > 0 else 0.0
            offset = float(y[keep].mean()) - drift * middle
            off = np.abs(y - offset - drift * x)
            keep = off <= max(4.0 * float(np.median(off)), 1e-9)
        if n >= min(len(a), most):
            break
        n = min(4 * n, len(a), most)
    mean = float(np.sqrt(np.mean(off**2)))
    unpaired = 1.0 - float(np.sum(_pair(a, b, offset, drift, period) >= 0)) / min(len(a), len(b))
    # the residual decides only between equals: a start that pairs fewer events with the same agreement
    return _Clocks(offset, drift, MAD_TO_STD * float(np.median(off)), mean + 1e-3 * period * unpaired)


def _pair(a: Array, b: Array, offset: float, drift: float, period: float) -> Array:
    """For every row the sample within 0.4 periods of it, or -1; no sample is taken twice."""
    wanted = a + offset + drift * (a - a[0])
    right = np.clip(np.searchsorted(b, wanted), 1, len(b) - 1)
    nearest = np.where(np.abs(b[right - 1] - wanted) <= np.abs(b[right] - wanted), right - 1, right)
    nearest = np.where(np.abs(b[nearest] - wanted) < 0.4 * period, nearest, -1)
    twice = np.flatnonzero((nearest[1:] == nearest[:-1]) & (nearest[1:] >= 0)) + 1
    nearest[twice] = -1
    return nearest
