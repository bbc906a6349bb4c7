"""Rows without a measurement: interpolated, so that filters and differences can pass over them, and without weight."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from diagnosis.residual.run import Run

SMEARED = 0.05
"""s by which filters spread interpolated rows."""
NO_WEIGHT = 1e6
"""Factor on the std of a row that is not to count."""


def without_weight(run: Run, spans: Iterable[tuple[float, float]], joint: int | None = None) -> Run:
    """The run with rows of no weight in each of the ``spans``: first and last time, s of ``Run.t``.

    joint  (from 1) whose rows they are; None: of all
    """
    deviation, column = run.deviation.copy(), slice(None) if joint is None else joint - 1
    smeared = tuple((start - SMEARED, end + SMEARED, joint) for start, end in spans)
    for start, end, _ in smeared:
        deviation[(run.t > start) & (run.t < end), column] *= NO_WEIGHT
    return replace(run, deviation=deviation, unmeasured=run.unmeasured + smeared)
