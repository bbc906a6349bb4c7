"""The residual of a recording under other effects than those of its model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import EffectTerm
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.filters import kept_rows, rate_of
from diagnosis.residual.run import Run
from identification.selection import BLOCK_SECONDS


def residual_with(run: Run, terms: Sequence[EffectTerm]) -> Array:
    """(m, n) A: ``Run.residual`` of a recording under its arm with more effects."""
    return residual_under(run, (*run.arm.effects, *terms))


def residual_under(run: Run, effects: Sequence[EffectTerm]) -> Array:
    """(m, n) A: the residual of a recording under its arm with these effects instead of its own."""
    if tuple(effects) == run.arm.effects:
        return run.residual
    for known, residual in run.residuals:
        if known == tuple(effects):
            return residual
    residual = run.current - _expected(run, (*effects, *run.own))
    residual.flags.writeable = False
    run.residuals.append((tuple(effects), residual))
    return residual


def with_own(run: Run, terms: Sequence[EffectTerm]) -> Run:
    """The run with these effects of its recording alone, in the place of those that it had."""
    if tuple(terms) == run.own:
        return run
    return replace(run, own=tuple(terms), expected=_expected(run, (*run.arm.effects, *terms)))


def weighted_with(run: Run, terms: Sequence[EffectTerm]) -> Array:
    """(m, n) ``residual_with`` over its std; 0 where rows are not compared."""
    return np.asarray(residual_with(run, terms) / run.deviation * comparable_rows(run))


def block_numbers(runs: Sequence[Run]) -> NDArray[np.intp]:
    """(rows * n,) number of the block of time of every residual current, of one recording after the other."""
    numbers: list[NDArray[np.intp]] = []
    for run in runs:
        seconds = (np.arange(len(run.t)) // round(BLOCK_SECONDS * run.per_second)).astype(np.intp)
        numbers.append(np.repeat(seconds + (int(numbers[-1][-1]) + 1 if numbers else 0), len(run.arm)))
    return np.concatenate(numbers)


def _expected(run: Run, effects: Sequence[EffectTerm]) -> Array:
    """(m, n) A: the current that the arm of a run predicts with these effects instead of its own."""
    return run.evaluations.expected(replace(run.arm, effects=tuple(effects)), kept_rows(rate_of(run.raw[0])))
