"""A recording as blocks of columns, at the pace at which it was made."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from daq.recording import Recording

COLUMNS = (
    "number", "wall_ns", "host_ns", "tick", "time", "counts", "volts", "quality",
    "q", "i", "qref", "ql", "v", "temp", "xyz", "points",
)  # fmt: skip
"""Those of ``Recording`` that are published, under the same names, where a recording has them."""


def columns_of(recording: Recording) -> dict[str, NDArray]:
    """All columns, each with one entry a row; t (n,) s from the first row is always there."""
    columns = {name: getattr(recording, name) for name in COLUMNS}
    return {"t": recording.t} | {name: values for name, values in columns.items() if values is not None}


def blocks_of(recording: Recording, seconds: float = 0.01) -> Iterator[tuple[float, dict[str, NDArray]]]:
    """Blocks of at most ``seconds`` of acquisition time, each with the time of its last row (s since the first)."""
    columns, t = columns_of(recording), recording.t
    starts = np.searchsorted(t, np.arange(t[0], t[-1] + seconds, seconds)) if len(t) else np.empty(0, np.int64)
    edges = np.unique(np.append(starts, len(t)))
    for start, end in zip(edges[:-1].tolist(), edges[1:].tolist()):
        yield float(t[end - 1] - t[0]), {name: values[start:end] for name, values in columns.items()}


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
