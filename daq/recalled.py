"""Points that a tracker kept in its memory, put into the rows of the run once it is over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.rows import Rows
from drivers.shapes import Block, Quality
from drivers.tracker_merge import align


def merge_points(held: list[Rows], memory: Block, period: float, notes: list[str]) -> Iterator[Rows]:
    """The rows of a run with the points of their triggers.

    held    all rows of the run, in order
    memory  what the tracker recalled
    period  s between triggers
    notes   is told how the two were laid over each other, where that is not plain
    """
    if not held:
        return
    number = np.concatenate([rows.number for rows in held])
    host = np.concatenate([rows.host_ns for rows in held])
    frame = _frames(number, host, memory, period, notes)
    begin = 0
    for rows in held:
        mine = frame[begin : begin + len(rows)]
        begin += len(rows)
        there = mine >= 0
        points = np.full((len(rows), 3), np.nan)
        quality = rows.quality.copy()
        quality[:, -1] = Quality.MISSING
        if memory.points is not None:
            points[there] = memory.points[mine[there]]
            quality[there, -1] = memory.quality[mine[there], -1]
        yield replace(rows, points=points, quality=quality)


def _frames(
    number: NDArray[np.int64], host: NDArray[np.int64], memory: Block, period: float, notes: list[str]
) -> NDArray[np.int64]:
    """(n,) place in the memory of each row, -1 for none.

    Where the tracker tells its own time, edges and frames are laid over each other by count and jitter of their intervals
    (``drivers.tracker_merge``); else frame k is trigger k.
    """
    if len(memory) >= 3 and len(number) >= 3 and memory.tick[-1] > memory.tick[0]:
        pace = float(np.median(np.diff(memory.tick) / np.diff(memory.number)))
        try:
            found = align((host - host[0]) * 1e-9, memory.number, (memory.tick - memory.tick[0]) / pace * period)
        except ValueError as error:
            notes.append(f"tracker: its points were taken by their number, because {error}")
        else:
            if found.certain:
                return found.frame
            notes.append(f"tracker: its points were taken by their number, because {found.why}")
    if len(memory) == 0:
        return np.full(len(number), -1, np.int64)
    place = np.minimum(np.searchsorted(memory.number, number), len(memory) - 1)
    return np.where(memory.number[place] == number, place, -1)
