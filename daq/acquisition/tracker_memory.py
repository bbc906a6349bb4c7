"""Points that a tracker kept in its memory, put into the rows of the run once it is over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.join import nearest
from daq.acquisition.rows import Rows
from drivers.protocols import Block, EdgeSource, Plan, Quality
from drivers.tracker_stream import align


def merge_points(held: list[Rows], memory: Block, plan: Plan, notes: list[str]) -> Iterator[Rows]:
    """The rows of a run with the points of their triggers.

    held    all rows of the run, in order
    memory  what the tracker recalled
    plan    whether the tracker was the clock, and the rate
    notes   receives how the two were matched, where that is ambiguous
    """
    if not held:
        return
    number = np.concatenate([rows.number for rows in held])
    host = np.concatenate([rows.host_ns for rows in held])
    if plan.source is EdgeSource.TRACKER:
        frame = _frames(number, host, memory, 1.0 / plan.rate, notes)
    else:
        frame = _frames_by_time(host, memory, notes)
    begin = 0
    for rows in held:
        of_rows = frame[begin : begin + len(rows)]
        begin += len(rows)
        there = of_rows >= 0
        points = np.full((len(rows), 3), np.nan)
        quality = rows.quality.copy()
        quality[:, -1] = Quality.MISSING
        if memory.points is not None:
            points[there] = memory.points[of_rows[there]]
            quality[there, -1] = memory.quality[of_rows[there], -1]
        yield replace(rows, points=points, quality=quality)


def _frames(
    number: NDArray[np.int64], host: NDArray[np.int64], memory: Block, period: float, notes: list[str]
) -> NDArray[np.int64]:
    """(n,) place in the tracker's memory of each row, -1 for none.

    If the tracker reports its own time, edges and frames are matched by count and jitter of their intervals
    (``drivers.tracker_stream.merge``); else frame k is trigger k.
    """
    if len(memory) >= 3 and len(number) >= 3 and memory.tick[-1] > memory.tick[0]:
        pace = float(np.median(np.diff(memory.tick) / np.diff(memory.number)))
        try:
            found = align((host - host[0]) * 1e-9, memory.number, (memory.tick - memory.tick[0]) / pace * period)
        except ValueError as error:
            notes.append(f"tracker: its points were matched by number, because {error}")
        else:
            if found.certain:
                return found.frame
            notes.append(f"tracker: its points were matched by number, because {found.why}")
    if len(memory) == 0:
        return np.full(len(number), -1, np.int64)
    place = np.minimum(np.searchsorted(memory.number, number), len(memory) - 1)
    return np.where(memory.number[place] == number, place, -1)


def _frames_by_time(host: NDArray[np.int64], memory: Block, notes: list[str]) -> NDArray[np.int64]:
    """Likewise for a tracker that samples on its own time: each point belongs to the row nearest to it."""
    if len(memory) < 2 or memory.host[-1] <= memory.host[0]:
        notes.append("tracker: its points have no host time and were omitted")
        return np.full(len(host), -1, np.int64)
    place, first = nearest(memory.host, host)
    return np.where(first, place, -1)
