"""Long recordings reduced to stretches of time, evenly spread: bounded memory and time whatever their length.

The search holds what each of several hundred candidates adds to every row, 2 kB per joint and row. An hour of the same
arm adds little to four minutes spread over it: what a model leaves unexplained repeats with the motion, and slow
changes show between the stretches.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.recording import Recording
from diagnosis.screening.time_split import part, stillest

MOST = 1080.0
"""s, times joints: three minutes of a six-joint arm, fitted and held-out recordings together."""
LENGTH = 30.0
"""s: approximate length of a stretch."""
LEAST = 10.0
"""s of every recording that are kept: there may be many short ones, each with its own motion."""
NEAR = 3.0
"""s within which a stretch begins where the arm moves least."""


def examined(
    fit: Sequence[Recording], held_out: Sequence[Recording], most: float = MOST
) -> tuple[list[Recording], list[Recording], str | None]:
    """The recordings, cut into stretches with a time of their own from 0 if they exceed ``most`` s times joints.

    The third value is a remark for the report, or None.
    """
    recordings = [*fit, *held_out]
    total = sum(duration(recording) for recording in recordings)
    share = most / max(sum(duration(recording) * recording.joints for recording in recordings), 1e-9)
    if share >= 1.0:
        return list(fit), list(held_out), None
    fit_stretches, held_out_stretches = (
        [piece for recording in side for piece in stretches(recording, share)] for side in (fit, held_out)
    )
    kept_seconds = sum(duration(recording) for recording in [*fit_stretches, *held_out_stretches])
    note = (
        f"{kept_seconds:.0f} s in {len(fit_stretches) + len(held_out_stretches)} stretches, evenly spread over "
        f"{total:.0f} s of recordings, were examined; events between them were not searched for, and friction drift "
        "restarts in each"
    )
    return fit_stretches, held_out_stretches, note


def stretches(recording: Recording, share: float) -> list[Recording]:
    """Copied parts of a recording, evenly spread, of ``share`` of its length in total; the rest can be freed."""
    seconds = duration(recording)
    kept_seconds = min(max(share * seconds, LEAST), seconds)
    count = max(1, round(kept_seconds / LENGTH))
    rows, reach = int(kept_seconds / count / recording.dt), int(NEAR / recording.dt)
    cut = []
    for row in np.linspace(0, len(recording) - rows, count).astype(int).tolist():
        low, high = max(0, row - reach), min(row + reach, len(recording) - rows)
        start = stillest(recording, low, high, row) if row > 0 and low < high else row
        cut.append(part(recording, slice(start, start + rows), copied=True))
    return cut


def duration(recording: Recording) -> float:
    """s from the first row to the last."""
    return float(recording.t[-1] - recording.t[0]) if len(recording) else 0.0
