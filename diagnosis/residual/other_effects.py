"""The residual of a recording under other effects than those of its model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import EffectTerm
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.expected_current import springs_at, terms_of
from diagnosis.residual.filters import COMPARE_BAND, Motion, kept_rows, rate_of
from diagnosis.residual.integration import in_series, swings
from diagnosis.residual.run import Run
from identification.selection import BLOCK_SECONDS
from identification.selection.cluster_covariance import numbered_on

LASTS = 0.5
"""s: of a swing that falls by less than 1 / e in it, a recording shows the beginning."""
THERE = 0.25
"""Of what a spring adds, a residual shows at least so much where it is there: what the search allows."""
NO_CHANCE = 7.0
"""Squares that a swing explains, per way to begin and over those left per independent row: F of two, p of 0.001."""


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
    residual -= _swinging(run, effects, residual)
    residual.flags.writeable = False
    run.residuals.append((tuple(effects), residual))
    return residual


def with_own(run: Run, terms: Sequence[EffectTerm]) -> Run:
    """The run with these effects of its recording alone, in the place of those that it had."""
    if tuple(terms) == run.own:
        return run
    expected = _expected(run, (*run.arm.effects, *terms))
    expected += _swinging(run, (*run.arm.effects, *terms), run.current - expected)
    return replace(run, own=tuple(terms), expected=expected)


def as_encoders_read(run: Run, q: Array) -> Run:
    """The run with angles q (k, n) rad in place of those recorded: its residual, not the motion of its columns."""
    other = replace(run, raw=(run.raw[0], q))
    return replace(other, expected=_expected(other, (*run.arm.effects, *run.own)))


def weighted_with(run: Run, terms: Sequence[EffectTerm]) -> Array:
    """(m, n) ``residual_with`` over its std; 0 where rows are not compared."""
    return np.asarray(residual_with(run, terms) / run.deviation * comparable_rows(run))


def block_numbers(runs: Sequence[Run]) -> NDArray[np.intp]:
    """(rows * n,) number of the block of time of every residual current, of one recording after the other."""
    blocks = [np.arange(len(run.t)) // round(BLOCK_SECONDS * run.per_second) for run in runs]
    return numbered_on([np.repeat(own, len(run.arm)) for own, run in zip(blocks, runs)])


def _expected(run: Run, effects: Sequence[EffectTerm]) -> Array:
    """(m, n) A: the current that the arm of a run predicts with these effects instead of its own."""
    return run.evaluations.expected(replace(run.arm, effects=tuple(effects)), kept_rows(rate_of(run.raw[0])))


def beginning_in_swing(run: Run) -> Run:
    """The run with what the springs of its arm do if links swing as it begins."""
    if not any(springs_at(terms_of(run.arm), j + 1) for j in range(len(run.arm))):
        return run
    return replace(run, expected=run.expected + _swinging(run, run.arm.effects, run.residual))


def _swinging(run: Run, effects: Sequence[EffectTerm], residual: Array) -> Array:
    """(m, n) A: what links that still swing as a recording begins most likely add, of the ``residual`` (m, n) A.

    The model has them at rest then. A link that was moved before swings on behind its spring, by as much as its load
    winds that up (one std; posterior mean). Springs that ring beyond the band of comparison, or for less than
    ``LASTS``, leave nothing.
    """
    terms, every = terms_of(replace(run.arm, effects=tuple(effects))), slice(0, len(run.arm))
    change = np.zeros_like(residual)
    springs = [(j, in_series(several)) for j in range(len(run.arm)) if (several := springs_at(terms, j + 1))]
    for part in range(len(run.parts)):
        free = [run.moved(j, every, one) for j, spring in springs for one in _free_swings(run, j, *spring, part)]
        if free:
            white = [run.whiten(values)[run.parts[part]].ravel() for values in (*free, residual)]
            _, sizes = _likely(np.column_stack(white[:-1]), white[-1], run.alike)
            change += sum(size * values for values, size in zip(free, sizes))
    return change


def swinging_beside(run: Run, j: int, spring: tuple[float, float], change: Array, at: slice) -> Array:
    """(m, k) A: what the link of joint j (from 0) adds if it swings as recordings begin, per unit of its spring.

    change: (m, k) A that the spring does at the joints ``at``, of which the residual of joint j shows some multiple.
    """
    own, added = slice(j, j + 1), np.zeros_like(change)
    for part in range(len(run.parts)):
        free = list(_free_swings(run, j, *spring, part))
        if not free:
            continue
        rows = [change[:, j - at.start], *(run.moved(j, own, one)[:, 0] for one in free), run.residual[:, j]]
        white = run.whiten_at(np.column_stack(rows), j + 1)[run.parts[part]]
        shown, sizes = _likely(white[:, 1:-1], white[:, -1], run.alike, white[:, :1])
        if shown > THERE:
            added += sum(size / shown * run.moved(j, at, one) for one, size in zip(free, sizes))
    return added


def _free_swings(run: Run, j: int, stiffness: float, damping: float, part: int) -> Iterator[Motion]:
    """How much further (m,) rad (m) the link of joint j (from 0) is, with rates, per std of each way to begin.

    In the rows of one of the ``Run.parts``, and 0 in the others.
    """
    rows, step = run.parts[part], 1.0 / run.rates[part]
    mass, load = run.inertia[rows, j].mean(), np.abs(run.brisk_rigid[rows, j]).max()
    if not stiffness < mass * (2 * np.pi * COMPARE_BAND) ** 2 or damping * LASTS > 2.0 * mass:
        return
    wound_up = load / stiffness, load / np.sqrt(stiffness * mass)
    of_part = swings(run.inertia[rows, j], stiffness, damping, step, run.eased(j)[rows])
    for size, motion in zip(wound_up, of_part):
        angle, speed, acceleration = (np.zeros(len(run.t)) for _ in motion)
        angle[rows], speed[rows], acceleration[rows] = (-size * values for values in motion)
        yield angle, speed, acceleration


def _likely(x: Array, y: Array, alike: float, beside: Array | None = None) -> tuple[float, Array]:
    """Coefficient of a column ``beside`` (m, 1), 0 without, and (k,) of columns x (m, k), whose prior has std of one.

    The latter are 0 if they explain no more of y (m,) than chance would, of residuals as large as the rest of it.
    """
    beside = np.empty((len(y), 0)) if beside is None else beside
    both = np.column_stack([beside, x])
    prior = np.diag([0.0] * beside.shape[1] + [alike] * x.shape[1])
    found = np.linalg.lstsq(both.T @ both + prior, both.T @ y, rcond=None)[0]
    without, left = y - beside @ np.linalg.lstsq(beside, y, rcond=None)[0], y - both @ found
    chance = NO_CHANCE * x.shape[1] * alike * float(left @ left) / len(y)
    swings_on = float(without @ without - left @ left) > chance
    return float(found[: beside.shape[1]].sum()), found[beside.shape[1] :] * swings_on
