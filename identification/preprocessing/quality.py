"""Rows that the instruments flagged: which of them an identification may use, and what it reports about the others.

A value repeated from an earlier trigger, latched late, at the end of a counter's range or not there at all is no value
of its row. A current at the end of its converter's range is only known to be large: its rows go, with those that the
filters mix it into. After counts may have slipped (both lines of a quadrature encoder changed at once) or jumped (the
device restarted), every later angle of the joint is uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from daq.recording import Recording

Mask = NDArray[np.bool_]

NO_VALUE = ("stale", "late", "missing")
SLIPPED = {"quadrature_error": "counts may have slipped", "device_reset": "its counter restarted"}


@dataclass(frozen=True)
class Trusted:
    """The usable samples of a recording: q (n, J), i (n, J), NaN where the instrument had no value.

    saturated (n, J): currents at the end of the instrument's range.

    sentences  one per channel and flag
    counted    channel ('q2', 'i1') -> flag -> rows
    """

    q: Array
    i: Array
    saturated: Mask
    sentences: list[str]
    counted: dict[str, dict[str, int]]


def trusted(recording: Recording) -> Trusted:
    """The angles and currents of a recording, as far as its instruments stand by them."""
    q, i = recording.q.copy(), recording.i.copy()
    saturated = np.zeros(i.shape, bool)
    sentences: list[str] = []
    counted: dict[str, dict[str, int]] = {}
    for name, channel in (("q", q), ("i", i)):
        for flag, rows in recording.flagged("q" if name == "q" else "i").items():
            if flag in NO_VALUE or (flag == "saturated" and name == "q"):
                channel[rows] = np.nan
            elif flag == "saturated":
                saturated |= rows
            for j in np.flatnonzero(rows.any(axis=0)):
                count = int(rows[:, j].sum())
                counted.setdefault(f"{name}{j + 1}", {})[flag] = count
                sentences.append(_sentence(recording, f"{name}{j + 1}", flag, rows[:, j], count))
    return Trusted(q, i, saturated, sentences, counted)


def _sentence(recording: Recording, channel: str, flag: str, rows: Mask, count: int) -> str:
    where = f"{recording.path.name}: {channel}: "
    if flag in SLIPPED:
        return where + (
            f"{SLIPPED[flag]} at t = {recording.t[int(np.argmax(rows))]:.3f} s: later angles of the joint may be "
            "off by a constant"
        )
    return where + f"{count} of {len(rows)} rows marked {flag.upper()} by the instrument; left out"


def as_trusted(recording: Recording) -> Recording:
    """The recording with NaN for values that are none."""
    if recording.quality is None:
        return recording
    found = trusted(recording)
    return replace(recording, q=found.q, i=found.i)
