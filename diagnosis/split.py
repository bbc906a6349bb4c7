"""One recording split by time, where there is no other to judge by."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from daq.recording import Recording

FITTED = 0.6
"""Share of a recording that is fitted; the rest is held out."""


def split(recording: Recording) -> tuple[Recording, Recording]:
    """The first and the last part of a recording, each with its own time from 0. A weaker test than another run: say so."""
    rows = round(FITTED * len(recording))
    return _part(recording, slice(0, rows)), _part(recording, slice(rows, None))


def _part(recording: Recording, rows: slice) -> Recording:
    n = len(recording)
    cut: dict[str, Any] = {
        field.name: value[rows]
        for field in fields(recording)
        if isinstance(value := getattr(recording, field.name), np.ndarray) and len(value) == n
    }
    cut["t"] = cut["t"] - cut["t"][0]
    return replace(recording, **cut)
