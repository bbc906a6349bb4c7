"""Damping of the springs that link encoders or a tracker found, by the currents.

They show how far a transmission yields, hardly how its oscillation decays. With a spring without damping, the
currents that the extended model predicts would oscillate where the arm's do not. The damping is the one that leaves the
smallest error: of the closed loop in the band of resonances where the spring explains that error, else of the current
along the measured motion, conditional on everything else that was found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array, Progress
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE
from daq.recording import Recording
from diagnosis.cause import Cause, Estimate, extend
from diagnosis.closed_loop.loop_errors import Trial, loop_errors
from diagnosis.closed_loop.resonance import SEARCHED_IN
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.other_instruments import OtherInstruments
from diagnosis.residual.other_effects import block_numbers, weighted_with
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import has_demand
from diagnosis.screening.cleaned import Screened
from diagnosis.screening.residuals import residuals_of
from identification.selection import BLOCK_SECONDS
from identification.selection.cluster_covariance import cluster_covariance, numbered_on

RELAXATIONS = np.geomspace(2e-4, 2e-2, 8)
"""s: damping over stiffness of the trials; damping ratios of 0.001 to 0.1 at 10 rad/s, of 0.1 to 10 at 1000 rad/s."""
STEP = 0.1
"""Of a damping, by which it is changed for a derivative."""
EXPLAINED = 0.5
"""Share of the squared closed-loop error of its joint that a spring must explain for its damping to be judged there."""
SYSTEMATIC = 0.05
"""Share of a damping by which it is uncertain beside the errors: a resonance at a slightly wrong frequency, by an
uncertain stiffness, looks like one with more damping."""
REFINEMENTS = 2
"""Times that dampings between the neighbours of the best are tried."""
ROUNDS = 2
"""Times that each of several springs is estimated, with the damping that the others then have."""
SIGNIFICANT = 2.0
"""Std of a damping below which link encoders do not show it."""
DAMPING = "damping"
STIFFNESS = "stiffness"

Errors = Callable[[Array, float], Array]
"""(k, m) errors at some times with each of the dampings (k,), and a stiffness."""


def links_damped(
    arm: Arm, instruments: OtherInstruments, recordings: Recordings, screened: Screened, progress: Progress
) -> OtherInstruments:
    """The causes of the link encoders, springs with the damping of the currents where that is better known.

    Link encoders show damping by the time by which the twist lags its load, often less than a row. All that the
    currents show besides is not known yet: it adds to the std.
    """
    causes = list(instruments.of_links)
    places = [k for k, cause in enumerate(causes) if cause.of_arm and _insignificant(cause)]
    if instruments.link is None or not instruments.judged or not places:
        return instruments
    progress("estimating the damping of springs")
    for k in places:
        known = [cause for cause in instruments.in_model if cause.key != causes[k].key]
        runs = recordings.cut(residuals_of(extend(arm, known), screened).runs).fit
        value, std = _along_motion(causes[k], runs, ())
        if std < _of(causes[k], DAMPING).std:
            causes[k] = _with_damping(causes[k], value, std)
    return replace(instruments, link=replace(instruments.link, causes=causes))


def tracked_damped(
    instruments: OtherInstruments, currents: CurrentDiagnosis, fit: Sequence[Recording], progress: Progress
) -> OtherInstruments:
    """The same causes, with the damping of each spring of the tracker that is not in the model yet.

    Of one that the currents have found as well, too: theirs belongs to another stiffness. fit: the fitted recordings.
    """
    causes = list(instruments.tracked.causes)
    known = {cause.key for cause in (*instruments.in_model, *currents.outside_selection)}
    places = [k for k, cause in enumerate(causes) if _undamped(cause) and cause.key not in known]
    if not instruments.judged or not places:
        return instruments
    progress("estimating the damping of springs")
    for k in places:
        causes[k] = _with_damping(causes[k], _of(causes[k], STIFFNESS).value * float(np.median(RELAXATIONS)), 0.0)
    for _ in range(ROUNDS if len(places) > 1 else 1):
        for k in places:
            causes[k] = _damped(causes[k], [causes[other] for other in places if other != k], currents, fit)
    return replace(instruments, tracked=replace(instruments.tracked, causes=causes))


def _undamped(cause: Cause) -> bool:
    """Whether a cause is a spring whose damping is not known."""
    stated, every = ({p.name for p in one.parameters} for one in (cause, CATALOGUE[cause.effect]))
    return STIFFNESS in stated and DAMPING in every - stated


def _insignificant(cause: Cause) -> bool:
    """Whether a cause is a spring with a damping that may be zero."""
    of_both = [p for p in cause.parameters if p.name in (STIFFNESS, DAMPING)]
    return len(of_both) == 2 and _of(cause, DAMPING).value < SIGNIFICANT * _of(cause, DAMPING).std


def _of(cause: Cause, name: str) -> Estimate:
    """A parameter of a cause."""
    return next(p for p in cause.parameters if p.name == name)


def _with_damping(cause: Cause, value: float, std: float) -> Cause:
    """The spring with this damping."""
    others = [p for p in cause.parameters if p.name != DAMPING]
    return replace(cause, parameters=[*others, Estimate(DAMPING, value, std, CATALOGUE[cause.effect][DAMPING].unit)])


def _damped(cause: Cause, others: Sequence[Cause], currents: CurrentDiagnosis, fit: Sequence[Recording]) -> Cause:
    """The spring with its damping; ``others``: the other springs of the tracker."""
    springs = {one.key for one in (cause, *others)}
    arm = extend(currents.base, [*(one for one in currents.causes if one.key not in springs), *others])
    by_loops = _by_loops(cause, arm, [r for r in fit if has_demand(r)] if arm.controller else [])
    if by_loops is not None:
        return _with_damping(cause, *by_loops)
    terms = [term for term in currents.state.terms if (term.name, term.joint) not in springs]
    terms += [term for other in others for term in other.terms]
    return _with_damping(cause, *_along_motion(cause, currents.state.data.fit.runs, terms))


def _by_loops(cause: Cause, arm: Arm, fit: Sequence[Recording]) -> tuple[float, float] | None:
    """Damping and its std by the closed loops of recordings; None where the spring does not explain their errors."""
    if cause.joint is None or not fit or arm.joints[cause.joint - 1].rotor_inertia == 0.0:
        return None
    joint, at = cause.joint, [cause.joint - 1]

    without = [loop_errors(arm, r, at=at)[0, :, 0] for r in fit]
    worst = sorted(range(len(fit)), key=lambda k: -float(np.sum(without[k] ** 2)))[:SEARCHED_IN]
    fit, without = [fit[k] for k in worst], [without[k] for k in worst]

    def errors(dampings: Array, stiffness: float) -> Array:
        values = [{STIFFNESS: stiffness, DAMPING: damping} for damping in dampings.tolist()]
        trials = [Trial(cause.effect, joint, one) for one in values]
        return np.concatenate([loop_errors(arm, r, trials, at=at)[:, :, 0] for r in fit], axis=1)

    blocks = [np.arange(len(error)) // round(BLOCK_SECONDS / r.dt) for r, error in zip(fit, without)]
    value, std, left = _smallest(errors, _of(cause, STIFFNESS), numbered_on(blocks))
    explains = left < (1.0 - EXPLAINED) * sum(float(np.sum(e**2)) for e in without)
    return (value, std) if explains else None


def _along_motion(cause: Cause, runs: Sequence[Run], known: Sequence[EffectTerm]) -> tuple[float, float]:
    """Damping and its std by the residual currents along the measured motion, with the ``known`` effects as well."""

    def errors(dampings: Array, stiffness: float) -> Array:
        values = [{STIFFNESS: stiffness, DAMPING: damping} for damping in dampings.tolist()]
        several = [[*known, EffectTerm(cause.effect, cause.joint, one)] for one in values]
        return np.stack([np.concatenate([weighted_with(run, terms).ravel() for run in runs]) for terms in several])

    value, std, _ = _smallest(errors, _of(cause, STIFFNESS), block_numbers(runs))
    return value, std


def _smallest(errors: Errors, stiffness: Estimate, blocks: NDArray[np.intp]) -> tuple[float, float, float]:
    """The damping of the smallest squared error, its std, and that error.

    Errors are alike in ``blocks`` (m,) of time; what the stiffness is uncertain by makes the damping another.
    """
    tried = stiffness.value * RELAXATIONS
    for _ in range(REFINEMENTS):
        best = _best(errors(tried, stiffness.value))
        tried = np.geomspace(tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)], len(tried) - 1)
    value = float(tried[_best(errors(tried, stiffness.value))])
    left, moved = errors(np.array([value, (1.0 + STEP) * value]), stiffness.value)
    (stiffer,) = errors(np.array([value]), stiffness.value + stiffness.std) - left
    slope = (moved - left) / (STEP * value)
    if not np.isfinite([slope, stiffer]).all():
        return value, np.inf, np.inf
    by_errors = cluster_covariance(slope[:, None], [left], blocks)[0, 0]
    by_stiffness = (slope @ stiffer) / max(float(slope @ slope), 1e-300)
    std = float(np.sqrt(by_errors + by_stiffness**2 + (SYSTEMATIC * value) ** 2))
    return value, std, float(np.sum(left**2))


def _best(errors: Array) -> int:
    """The place of the smallest errors (k, m) in squares; a loop that is not stable has NaN."""
    return int(np.argmin(np.nan_to_num(np.sum(errors**2, axis=1), nan=np.inf)))
