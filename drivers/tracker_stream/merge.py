"""Which frame of a tracker's own file belongs to which edge of its trigger line.

Counting alone shifts everything by one when an edge is lost or a spike is counted. Here edges are first put on the grid
of the tracker's period (a lost edge leaves a hole, a spike lies off the grid), then the grid is laid over the frames so
that all of it is covered; where more than one place is left (edges lost at an end), the jitter of the intervals, which
edges and frames share, decides. Where that is too small to decide, the answer says so instead of guessing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HEAD = 16  # edges that the search for the grid begins with
OFF_GRID = 0.25  # of a period: an edge further away than that is no edge of the tracker
CLEARLY_BETTER = 0.5  # rms of the best place, at most this share of the next best's
RESOLVABLE = 3.0  # jitter, at least so many times the remaining jitter at the best place


@dataclass(frozen=True)
class Alignment:
    """frame (n,) int64: index into the frames for each edge, -1 for a spike (or an edge beyond the file).

    ``certain`` is False if another alignment fits as well; ``why`` is a sentence.
    """

    frame: NDArray[np.int64]
    certain: bool
    why: str


def align(edges: NDArray[np.float64], number: NDArray[np.int64], seconds: NDArray[np.float64]) -> Alignment:
    """Frames for edges.

    edges    (n,) s: edge times by the clock that saw them, increasing
    number   (m,): frame numbers in the file, increasing; gaps are frames that the file lacks
    seconds  (m,) s: the tracker's own time of each frame
    Both clocks may be offset and drift (some 100 ppm). Raises ValueError with fewer than 3 edges or frames.
    """
    if len(edges) < 3 or len(number) < 3:
        raise ValueError(f"{len(edges)} edges and {len(number)} frames: too few to find their order")
    grid, e_jitter, good = _grid(edges)
    period_frames = np.median(np.diff(seconds) / np.diff(number))
    f_jitter = _straight(number.astype(float), seconds, period_frames)
    place = {int(k): i for i, k in enumerate(number)}
    span = int(grid[good].max())
    first, last = int(number[0]), int(number[-1])
    shifts = np.arange(first, last - span + 1) if last - first >= span else np.arange(last - span, first + 1)
    jitter_at = np.full(last - first + 1, np.nan)
    jitter_at[number - first] = f_jitter
    rms = np.array([_misfit(grid[good], e_jitter[good], jitter_at, int(s) - first) for s in shifts])
    best = int(np.argmin(rms))
    frame = np.full(len(edges), -1, np.int64)
    for i in np.flatnonzero(good):
        frame[i] = place.get(int(grid[i]) + int(shifts[best]), -1)
    if len(shifts) == 1:
        return Alignment(frame, True, "as many edges as frames, holes counted")
    second = float(np.delete(rms, best).min())
    clear = rms[best] < CLEARLY_BETTER * second and np.std(f_jitter) > RESOLVABLE * rms[best]
    missing = len(shifts) - 1
    if clear:
        return Alignment(frame, True, f"{missing} edges lost at the ends; found by the jitter of the intervals")
    return Alignment(frame, False, f"{missing} edges lost at the ends, and the intervals are too even to find which")


def _grid(edges: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Place of each edge on the grid of the tracker's period (from 0), and two more arrays.

    These are the distance of each edge from its place (s), and whether it is an edge of the tracker (not interference).
    """
    period = float(np.median(np.diff(edges)))
    origin = _phase(edges[:HEAD], period)
    # A period known from n edges carries over some more than n: the stretch that is fitted grows, to all of them.
    stretch = HEAD
    while True:
        part = edges[:stretch]
        grid = np.rint((part - origin) / period).astype(np.int64)
        off = part - (origin + grid * period)
        good = (np.abs(off) < OFF_GRID * period) & _first_nearest(grid, off)
        if np.count_nonzero(good) < 3:
            raise ValueError("the edges lie on no grid: is the trigger line the tracker's?")
        period, origin = (float(v) for v in np.polyfit(grid[good], part[good], 1))
        if stretch >= 2 * len(edges):
            break
        stretch *= 2
    grid -= grid[good].min()
    return grid, edges - (origin + grid * period) - np.median(off[good]), good


def _phase(head: NDArray[np.float64], period: float) -> float:
    """An edge that most of the first ones agree with, so that a spike at the beginning does not set the grid."""
    off = np.abs((head[:, None] - head[None, :]) / period)
    agree = np.abs(off - np.rint(off)) < OFF_GRID / 2
    return float(head[int(np.argmax(agree.sum(axis=1)))])


def _first_nearest(grid: NDArray[np.int64], off: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Of several edges at one place of the grid, the nearest."""
    order = np.lexsort((np.abs(off), grid))
    keep = np.zeros(len(grid), bool)
    _, first = np.unique(grid[order], return_index=True)
    keep[order[first]] = True
    return keep


def _straight(x: NDArray[np.float64], y: NDArray[np.float64], slope: float) -> NDArray[np.float64]:
    """What is left of y after the best straight line."""
    centred = x - x.mean()
    line = np.polyfit(centred, y - slope * centred, 1)
    return y - slope * centred - np.polyval(line, centred)


def _misfit(grid: NDArray[np.int64], jitter: NDArray[np.float64], frames: NDArray[np.float64], shift: int) -> float:
    """rms difference (s) of the two jitters at this place, straight lines apart (the clocks' offset and drift)."""
    at = grid + shift
    inside = (at >= 0) & (at < len(frames))
    pairs = inside.copy()
    pairs[inside] = ~np.isnan(frames[at[inside]])
    if np.count_nonzero(pairs) < 3:
        return float("inf")
    difference = jitter[pairs] - frames[at[pairs]]
    return float(np.std(_straight(at[pairs].astype(float), difference, 0.0)))
