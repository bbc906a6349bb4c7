"""Rows that a recording leaves out, as its stamps say: a logger lost them, with all that was measured in them.

Nothing is out of step: angles and currents of every row belong together. The rows are put in again, so that what
filters and differences take as equally spaced is so. Where more than one is missing, they weigh nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.types import Array
from daq.recording import Recording
from diagnosis.residual.noise.encoder_step import as_readings
from diagnosis.residual.run import Run
from diagnosis.screening.even_rows import SPLINED, TORN, resampled
from diagnosis.screening.lost_rows.unmeasured_rows import without_weight
from identification.preprocessing.grid import on_grid
from identification.selection import MAD_TO_STD

SMOOTH = (*SPLINED, "qref")
"""Signals that go through a hole as a curve without overshoot; others go in straight lines, integers stay."""
SINGLE = 1.5
"""Periods between two rows of which one is missing, at least, where stamps hardly jitter and no neighbouring step is
shorter by as much."""
JITTER = 0.1
"""Of a period: std of the steps between stamps (by their median) up to which a single missing row shows in them."""


@dataclass(frozen=True)
class Hole:
    """Rows left out of a recording: ``rows`` of them before its row ``row``, from ``start`` to ``end`` s."""

    row: int
    rows: int
    start: float
    end: float


def holes_of(t: Array) -> tuple[Hole, ...]:
    """Where stamps t (n,) s leave out rows."""
    steps = np.diff(t)
    if not len(steps):
        return ()
    period = float(np.median(steps))
    torn = (steps > TORN * period) | _single(steps / period)
    return tuple(
        Hole(row=int(k) + 1, rows=int(np.rint(steps[k] / period)) - 1, start=float(t[k]), end=float(t[k + 1]))
        for k in np.flatnonzero(torn)
    )


def _single(steps: Array) -> NDArray[np.bool_]:
    """(k,) which of the steps between stamps (k,), in periods, have one row missing.

    A stamp that is late alone makes a long step and a short one. Stamps in whole units of about a period make long
    steps at equal distances, where no row is missing.
    """
    if MAD_TO_STD * float(np.median(np.abs(steps - 1.0))) > JITTER:
        return np.zeros(len(steps), bool)
    before, after = np.concatenate([[1.0], steps[:-1]]), np.concatenate([steps[1:], [1.0]])
    single = (steps > SINGLE) & (steps <= TORN) & (np.minimum(before, after) + steps > 1.0 + SINGLE)
    apart = np.diff(np.flatnonzero(single))
    return single & (len(apart) < 2 or np.ptp(apart) > 1)


def filled(recording: Recording, holes: Sequence[Hole]) -> Recording:
    """The recording with the rows of its holes interpolated (``SMOOTH``); the same object where it has none.

    InputError where more rows are left out than there are.
    """
    t, missing = recording.t, sum(hole.rows for hole in holes)
    if not missing:
        return recording
    if missing > len(t):
        longest = max(holes, key=lambda hole: hole.rows)
        raise InputError(
            recording.path,
            f"{missing} rows are missing, more than its {len(t)} (none from {longest.start:.3f} to "
            f"{longest.end:.3f} s); give the parts before and after as separate recordings",
        )
    stamps = np.insert(
        t,
        np.repeat([hole.row for hole in holes], [hole.rows for hole in holes]),
        np.concatenate([np.linspace(hole.start, hole.end, hole.rows + 2)[1:-1] for hole in holes]),
    )
    before = np.searchsorted(t, stamps, side="right") - 1
    curves = {name: partial(_read_across if name in SPLINED else _across, t, stamps) for name in SMOOTH}
    return resampled(recording, stamps, before, curves)


def _across(t: Array, stamps: Array, values: Array) -> Array:
    """(m, J) values (n, J) at the stamps (m,) s: as they are where rows are, interpolated where none is."""
    through = on_grid(t, values, stamps, float(np.median(np.diff(t))))[0]
    at = np.searchsorted(stamps, t)
    through[at] = values
    return through


def _read_across(t: Array, stamps: Array, values: Array) -> Array:
    """``_across`` of what an instrument reads, also where no row is."""
    measured = np.isin(stamps, t)
    return as_readings(_across(t, stamps, values), np.broadcast_to(measured[:, None], (len(stamps), values.shape[1])))


def without_skipped(run: Run, holes: Sequence[Hole]) -> Run:
    """A run in which rows that were left out weigh nothing; the same object where there are none.

    A row alone keeps its weight: what its neighbours do not show of it is far above the band of the residual.
    """
    longer = [hole for hole in holes if hole.rows > 1]
    if not longer:
        return run
    first = float(run.raw[0][0])
    return without_weight(run, ((hole.start - first, hole.end - first) for hole in longer))


def remark(recording: Recording, holes: Sequence[Hole]) -> str:
    """Says which rows are missing."""
    count = sum(hole.rows for hole in holes)
    places = ", ".join(f"{hole.rows} after {hole.start:.3f} s" for hole in holes[:3])
    further = f" and {len(holes) - 3} more" if len(holes) > 3 else ""
    return (
        f"{recording.path.name}: {count} row{'s are' if count > 1 else ' is'} missing by its time stamps "
        f"({places}{further}); interpolated, and without weight where more than one is missing at a time"
    )
