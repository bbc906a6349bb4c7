"""Recordings as rows to fit and rows to judge by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_model import Arm
from arm_model.effects import described
from arm_model.geometry import relinked
from daq.recording import Recording
from identification.floating_base.columns import Rows, rows_of
from identification.floating_base.rows import BaseRun, base_run

HELD_OUT = 0.3
"""Share at the end of each recording that judges a fit where no recording is held out."""


@dataclass(frozen=True)
class Sides:
    """Rows to fit and rows to judge by; ``split``: both are parts of the same recordings.

    runs: of the rows to judge by, in the order of their numbers.
    """

    fit: Rows
    held_out: Rows
    split: bool
    runs: Sequence[BaseRun] = ()


def sides(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], *, faults: bool = False) -> Sides:
    """Rows of recordings; InputError where one cannot be used. ``faults``: with those of ``columns.FAULTS``.

    Effects of the arm that are other numbers in its description act; others, such as friction, do not reach the base.
    """
    arm = described(relinked(arm))
    runs, held = ([base_run(recording, arm) for recording in side] for side in (fit, held_out))
    rows = rows_of(arm, runs, faults=faults)
    if held:
        return Sides(rows, rows_of(arm, held, faults=faults), False, held)
    last = late_rows(rows)
    return Sides(rows.part(~last), rows.part(last), True, runs)


def late_rows(rows: Rows) -> NDArray[np.bool_]:
    """(k,) the last rows of each run, which judge a fit of the others."""
    last = np.zeros(len(rows.t), bool)
    for number in np.unique(rows.run):
        of_run = np.flatnonzero(rows.run == number)
        last[of_run[int((1 - HELD_OUT) * len(of_run)) :]] = True
    return last
