"""One recording split by time, where no other one is held out."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from daq.recording import Recording

FITTED = 0.6
"""Share of a recording that is fitted, to within a fifth; the rest is held out."""


def split(recording: Recording) -> tuple[Recording, Recording]:
    """The first and the last part of a recording, each with its own time from 0: a weaker test than another run."""
    row = round(FITTED * len(recording))
    rows = stillest(recording, round(0.8 * row), round(1.2 * row), row)
    return part(recording, slice(0, rows)), part(recording, slice(rows, None))


def stillest(recording: Recording, low: int, high: int, row: int) -> int:
    """The row from ``low`` to ``high``, near ``row``, at which the arm moves least: recordings start at standstill."""
    near = np.arange(low, min(high, len(recording) - 2))
    if len(near) == 0:
        return row
    reach = max(1, round(0.01 / recording.dt))
    later, earlier = np.minimum(near + reach, len(recording) - 1), np.maximum(near - reach, 0)
    travel = np.abs(recording.q[later] - recording.q[earlier]) / np.maximum(np.ptp(recording.q, axis=0), 1e-12)
    slow = np.nan_to_num(travel, nan=np.inf).max(axis=1)
    still = near[slow <= slow.min() * 1.5 + 1e-9]
    return int(still[np.argmin(np.abs(still - row))])


def part(recording: Recording, rows: slice, *, copied: bool = False) -> Recording:
    """Some rows of a recording, with its own time from 0; views of its arrays unless ``copied``."""
    n = len(recording)
    cut: dict[str, Any] = {
        field.name: value[rows].copy() if copied else value[rows]
        for field in fields(recording)
        if isinstance(value := getattr(recording, field.name), np.ndarray) and len(value) == n
    }
    cut["t"] = cut["t"] - cut["t"][0]
    return replace(recording, **cut)
