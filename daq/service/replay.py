"""A recording as blocks of columns, at the pace at which it was made."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from daq.recording import LongRecording, Recording

BLOCK = 0.01
"""s: longest time of a block."""
COLUMNS = (
    "number",
    "wall_ns",
    "host_ns",
    "tick",
    "time",
    "counts",
    "volts",
    "quality",
    "q",
    "i",
    "qref",
    "ql",
    "v",
    "temp",
    "xyz",
    "points",
)
"""Those of ``Recording`` that are published, under the same names, where a recording has them."""


def columns_of(recording: Recording) -> dict[str, NDArray]:
    """All columns, each with one entry per row; t (n,) s from the first row is always there.

    Further columns of a table, such as the pose of a floating base, have their own names.
    """
    columns = {name: getattr(recording, name) for name in COLUMNS}
    there = {name: values for name, values in columns.items() if values is not None}
    return {"t": recording.t} | recording.extra | there


def blocks_of(recording: Recording | LongRecording) -> Iterator[tuple[float, dict[str, NDArray]]]:
    """Blocks of at most ``BLOCK`` s of acquisition time, each with the time of its last row (s since the first).

    Only the current chunk of a long recording is in memory.
    """
    remaining: dict[str, NDArray] = {}
    for part in recording.blocks():
        columns = columns_of(part)
        if remaining:
            columns = {name: np.concatenate([remaining[name], values]) for name, values in columns.items()}
        *edges, last = _edges(columns["t"])
        for start, end in zip(edges, [*edges[1:], last]):
            yield _block(columns, start, end)
        remaining = {name: values[last:] for name, values in columns.items()}
    if remaining and len(remaining["t"]):
        yield _block(remaining, 0, len(remaining["t"]))


def _edges(t: NDArray[np.float64]) -> list[int]:
    """The rows at which a new block begins; the last of them may go on."""
    return [0, *(np.flatnonzero(np.diff(np.floor(t / BLOCK))) + 1).tolist()]


def _block(columns: dict[str, NDArray], start: int, end: int) -> tuple[float, dict[str, NDArray]]:
    return float(columns["t"][end - 1]), {name: values[start:end] for name, values in columns.items()}


def paced(
    blocks: Iterator[tuple[float, dict[str, NDArray]]],
    speed: float,
    *,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[tuple[float, dict[str, NDArray]]]:
    """The same blocks, each when its last row is due at ``speed`` times the pace of the recording; inf: at once."""
    begin = now()
    for due, block in blocks:
        wait = begin + due / speed - now()
        if wait > 0:
            sleep(wait)
        yield due, block
