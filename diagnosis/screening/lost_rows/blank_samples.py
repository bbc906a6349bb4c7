"""Samples that are none: NaN, or flagged by the instrument as repeated, late, missing or at the end of its range.

They are interpolated, so that filters and differences go on, and weigh nothing. Angles and currents of other rows stay.
A current at the end of its converter's range keeps its value, for the searches for limits, and weighs nothing either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io import InputError
from arm_io.types import Array
from daq.recording import Recording
from diagnosis.residual.noise.encoder_step import as_readings
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.unmeasured_rows import SMEARED, without_weight
from identification.preprocessing.grid import on_grid
from identification.preprocessing.quality import NO_VALUE, trusted

MOST = 0.5
"""Share of the rows of a joint that may have no weight."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Blank:
    """Rows without a sample between those at ``start`` and ``end`` s.

    joint  (from 1) whose currents they are; None: angles, on which all currents depend
    """

    start: float
    end: float
    joint: int | None


def blanks_of(recording: Recording) -> tuple[Blank, ...]:
    """Where the currents of a joint, or any angles, have no sample."""
    angles, currents = _blank(recording)
    no_angle = np.asarray(angles.any(axis=1))
    blanks = [Blank(*span, None) for span in _spans(recording.t, no_angle)]
    for j, column in enumerate((currents & ~no_angle[:, None]).T, 1):
        blanks += [Blank(*span, j) for span in _spans(recording.t, column)]
    return tuple(blanks)


def without_blanks(recording: Recording) -> Recording:
    """The recording with interpolated samples where it has none; the same object where it has all.

    InputError where more than ``MOST`` of the rows of a joint would have no weight.
    """
    angles, currents = _blank(recording)
    if not (angles.any() or currents.any()):
        return recording
    _check_share(recording, angles, currents)
    with_gaps = trusted(recording)
    q, i = (_across(recording.t, values) for values in (with_gaps.q, with_gaps.i))
    return replace(recording, q=q, i=i)


def unweighted(run: Run, blanks: Sequence[Blank]) -> Run:
    """A run in which rows without a sample weigh nothing; the same object where there are none."""
    start = float(run.raw[0][0]) if blanks else 0.0
    for joint in dict.fromkeys(blank.joint for blank in blanks):
        spans = [(b.start - start, b.end - start) for b in blanks if b.joint == joint]
        run = without_weight(run, spans, joint)
    return run


def sentences(recording: Recording) -> list[str]:
    """Sentences on blank samples: flagged ones in the words of ``identify``, and NaN without a flag."""
    remarks = trusted(recording).sentences
    for name, values in (("q", recording.q), ("i", recording.i)):
        silent = np.isnan(values)
        for flag, rows in recording.flagged("q" if name == "q" else "i").items():
            silent &= ~rows if flag in NO_VALUE else True
        for j in np.flatnonzero(silent.any(axis=0)):
            first = recording.t[int(np.argmax(silent[:, j]))]
            remarks.append(
                f"{recording.path.name}: {name}{j + 1}: {int(silent[:, j].sum())} of {len(silent)} rows without a "
                f"value, the first at {first:.3f} s; left out"
            )
    return remarks


def _blank(recording: Recording) -> tuple[Mask, Mask]:
    """(n, J) angles and currents that have no value, or are only known to be large."""
    signals = trusted(recording)
    angles: Mask = np.isnan(signals.q)
    currents: Mask = np.isnan(signals.i) | signals.saturated
    return angles, currents


def _spans(t: Array, blank: Mask) -> list[tuple[float, float]]:
    """Times of the samples before and after each group of blank rows (n,); groups closer than filters reach are one."""
    reach = max(1, round(2.0 * SMEARED / float(np.median(np.diff(t)))))
    closed = ndimage.binary_closing(np.pad(blank, reach), np.ones(reach + 1, bool))[reach:-reach] | blank
    places, count = ndimage.label(closed)
    last = len(t) - 1
    rows = [place[0] for place in ndimage.find_objects(places, count)]
    return [(float(t[max(group.start - 1, 0)]), float(t[min(group.stop, last)])) for group in rows]


def _check_share(recording: Recording, angles: Mask, currents: Mask) -> None:
    """InputError if filters spread the blank rows over too large a part of a joint's rows."""
    t, no_angle = recording.t, angles.any(axis=1)
    for j in range(currents.shape[1]):
        blank = no_angle | currents[:, j]
        lost = np.zeros(len(t), bool)
        for start, end in _spans(t, blank):
            lost |= (t > start - SMEARED) & (t < end + SMEARED)
        if lost.mean() > MOST:
            of_current = currents[:, j].sum() > no_angle.sum()
            channel = f"i{j + 1}" if of_current else f"q{int(angles.sum(axis=0).argmax()) + 1}"
            raise InputError(
                recording.path,
                f"{channel}: {blank.mean():.1%} of the rows have no value, the first at {t[int(np.argmax(blank))]:.3f} "
                f"s; with the rows that filters combine with them, {lost.mean():.0%} of joint {j + 1} cannot be judged "
                f"(limit: {MOST:.0%}); check the wiring of the channel, or give a part without them",
            )


def _across(t: Array, values: Array) -> Array:
    """(n, J) readings with the NaN among them interpolated."""
    if not np.isnan(values).any():
        return values
    filled = values.copy()
    through = on_grid(t, values, t, float(np.median(np.diff(t))))[0]
    filled[np.isnan(values)] = through[np.isnan(values)]
    return as_readings(filled, ~np.isnan(values))
