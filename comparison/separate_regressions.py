"""One regression per recording, with columns that mean the same in every recording of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from comparison.regression import Fitted, Rows, Structure, fit, rows_of, shown_by, structure_of, unfitted
from daq.recording import Recording
from diagnosis.residual.run_setup import set_up
from identification.preprocessing.signals import Motion
from identification.regression.base_parameters import structural_base
from identification.ripples import wide

ROWS_PER_VALUE = 2
"""Rows of a regression per value that it asks for, at least."""


@dataclass(frozen=True, kw_only=True)
class SeparateRegressions:
    """The regressions of n recordings, one each, of the c values of a structure.

    is_before  (n,) True for recordings of the side before
    rows       of every recording; fits: of none that is too short, which shows nothing alone
    shown      (n, c) values that each recording shows
    too_short  why each cannot be judged alone; "" where it can
    """

    structure: Structure
    names: Sequence[str]
    is_before: NDArray[np.bool_]
    rows: list[Rows]
    fits: list[Fitted]
    shown: NDArray[np.bool_]
    too_short: list[str]

    def long_enough(self) -> tuple[list[Fitted], NDArray[np.bool_]]:
        """The fits of recordings that can be judged alone, and whether each is of the side before."""
        long = np.array([not why for why in self.too_short])
        return [fitted for fitted, kept in zip(self.fits, long) if kept], self.is_before[long]

    def mean_values(self) -> Array:
        """(c,) of all recordings that show them; NaN where none does."""
        values = np.array([fitted.values for fitted in self.fits])
        seen = np.isfinite(values)
        total = np.where(seen, values, 0.0).sum(axis=0)
        return np.where(seen.any(axis=0), total / np.maximum(seen.sum(axis=0), 1), np.nan)


def separate_regressions(
    arm: Arm,
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    is_before: NDArray[np.bool_],
    progress: Progress,
) -> SeparateRegressions:
    """Of the values that the recordings have in common; ``motions``: theirs, smoothed.

    Where both sides have recordings that are long enough, what these show of friction is compared.
    """
    base = structural_base(arm, "asymmetric")
    names = [recording.path.name for recording in recordings]
    structure = structure_of(arm, base, motions, names, is_before)
    separate = regressions_of(structure, recordings, motions, motions, is_before, progress)
    long = [k for k, why in enumerate(separate.too_short) if not why]
    if len(long) < len(names) and is_before[long].any() and not is_before[long].all():
        structure = structure_of(arm, base, [motions[k] for k in long], [names[k] for k in long], is_before[long])
        separate = regressions_of(structure, recordings, motions, motions, is_before, progress)
    return separate


def regressions_of(
    structure: Structure,
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    whole: Sequence[Motion],
    is_before: NDArray[np.bool_],
    progress: Progress,
) -> SeparateRegressions:
    """Of the values of a ``structure``; ``whole`` as of ``rows_of``. InputError where all recordings are too short."""
    names = [recording.path.name for recording in recordings]
    data: list[Rows] = []
    shown: list[NDArray[np.bool_]] = []
    too_short: list[str] = []
    for recording, motion, of_all in zip(recordings, motions, whole):
        progress(Step("equations", len(data), len(recordings), detail=recording.path.name))
        rows, seen, why = _enough_rows(structure, recording, motion, of_all)
        data.append(rows)
        shown.append(seen)
        too_short.append(why)
    if all(too_short):
        raise InputError(recordings[0].path, too_short[0])
    model, joints = structure.model(), len(structure.arm)
    fits: list[Fitted | None] = []
    for name, rows, seen, why in zip(names, data, shown, too_short):
        progress(Step("regression", len(fits), len(recordings), detail=name))
        fits.append(None if why else fit(rows, seen, model, joints))
    block = max(fitted.block for fitted in fits if fitted is not None)
    return SeparateRegressions(
        structure=structure,
        names=names,
        is_before=is_before,
        rows=data,
        fits=[unfitted(rows, structure, block) if fitted is None else fitted for fitted, rows in zip(fits, data)],
        shown=np.array(shown),
        too_short=too_short,
    )


def _enough_rows(
    structure: Structure, recording: Recording, motion: Motion, whole: Motion
) -> tuple[Rows, NDArray[np.bool_], str]:
    """The rows of a recording, (c,) what they show, and why it is too short to judge alone; "" where it is not.

    Rows come at 2.5 times the band of the motion. Of a slow one, with rests, they may be fewer than deviations need: it
    is then taken in the band of the joint fit, if it shows friction as the others do.
    """
    carrying = set_up(structure.arm, recording)
    rows = rows_of(structure, motion, carrying, whole)
    if not len(rows.y):
        raise InputError(recording.path, "leaves no usable row: give a longer recording, with fewer samples missing")
    shown = shown_by(rows, structure)
    least = ROWS_PER_VALUE * (int(shown.sum()) + rows.own.shape[1])
    if len(rows.y) >= least:
        return rows, shown, ""
    more = rows_of(structure, wide(whole), carrying, whole)
    shown_more = shown_by(more, structure)
    friction = shown_more[len(structure.rows) : len(structure.rows) + len(structure.points)]
    if friction.any() and len(more.y) >= ROWS_PER_VALUE * (int(shown_more.sum()) + more.own.shape[1]):
        return more, shown_more, ""
    length = float(whole.t[-1] - whole.t[0])
    lacking = np.ceil(length * (least / max(len(rows.y), 1) - 1.0))
    why = (
        f"is too short to judge alone: at least {lacking:.0f} s more of such motion are needed (it has {length:.2g} s, "
        f"which leave {len(rows.y)} rows for {least // ROWS_PER_VALUE} parameters)"
    )
    return rows, np.zeros_like(shown), why
