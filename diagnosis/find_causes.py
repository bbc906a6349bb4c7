"""Causes in the currents, conditional on what is known of an arm.

The search and its verification, friction near rest, values that differ between recordings, and resonances in closed
loop: each of the last three is found in what the search leaves, and the search is repeated with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm_io.types import Progress
from arm_model import Arm
from diagnosis.cause import Cause, EffectKey, extend
from diagnosis.closed_loop.resonance import transmissions
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.currents.causes import from_axis
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, bounded, dataset_of, dataset_with, free_columns
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.model_errors import model_uncertainty
from diagnosis.measurements.currents.search import above_noise
from diagnosis.measurements.currents.shortage import shortage
from diagnosis.measurements.near_rest.time_at_rest import with_rise_at_rest
from diagnosis.measurements.single_axis.causes import AxisSide, axis_side, load_changes
from diagnosis.outside_selection import (
    friction_in_place,
    friction_near_rest,
    gaps,
    resonance_in_loop,
    rows_lost_in_loop,
    transmission_in_place,
)
from diagnosis.per_recording.search import per_recording
from diagnosis.per_recording.values import cause_of
from diagnosis.residual.expected_current import has_dynamics
from diagnosis.residual.run import Run
from diagnosis.residual.warmth import depends, not_warmed
from diagnosis.screening.cleaned import Screened, with_rows_put_back, with_simulated_loops
from diagnosis.screening.lost_rows.lost_triggers import event_of
from diagnosis.screening.residuals import Residuals, confirmed, realigned, residuals_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from diagnosis.selection.harmonics import with_harmonics
from diagnosis.selection.ripple_orders import is_of_gravity, of_shafts, order_of
from diagnosis.verification.beyond_folding import beyond_folding, resolved
from diagnosis.verification.folded_alike import folded_alike, with_folding
from diagnosis.verification.held_currents import as_held
from diagnosis.verification.smoothing_velocity import other_smoothing
from diagnosis.verification.tenable import tenable_causes
from identification.selection import Split

LOOPS = 2
"""Searches with other simulated loops after the first, in whose loops all causes are missing."""
AS_MUCH = 1.02
"""Squared held-out residual that fewer causes may leave, over that of more."""
SETTLED = 0.2
"""Std of the residual, rms, by which the residuals of closed loops must differ for another search."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """One search for causes in the currents of recordings.

    model          without any cause
    given          causes that encoders and tracker have shown
    near_rest, transmissions  causes that were found outside the stepwise selection (``CurrentDiagnosis``)
    excluded       effects that the search may not choose
    """

    model: Arm
    given: tuple[Cause, ...]
    near_rest: tuple[Cause, ...] = ()
    transmissions: tuple[Cause, ...] = ()
    excluded: frozenset[EffectKey]
    recordings: Recordings
    screened: Screened
    progress: Progress

    @cached_property
    def known(self) -> tuple[Cause, ...]:
        """All causes that are known before the search."""
        return (*self.given, *self.near_rest, *self.transmissions)

    @cached_property
    def arm(self) -> Arm:
        """The model with the known causes."""
        return extend(self.model, self.known) if self.known else self.model

    def residuals(self) -> Residuals:
        """Residuals of the recordings with ``arm`` as the model."""
        return residuals_of(self.arm, self.screened, self.progress)

    def simulating(self, arm: Arm) -> Search:
        """The same with simulated closed loops of that arm for recordings without noise."""
        return replace(self, screened=with_simulated_loops(self.screened, arm))

    def excluding(self, effects: Iterable[EffectKey]) -> Search:
        """The same with more effects that it may not choose."""
        return replace(self, excluded=self.excluded.union(effects))

    def with_near_rest(self, friction: Sequence[Cause]) -> Search:
        """The same with more friction near rest as known causes."""
        return replace(self, near_rest=(*self.near_rest, *friction)).excluding(cause.key for cause in friction)

    def with_transmissions(self, found: Sequence[Cause]) -> Search:
        """The same with more springs and gaps as known causes: of their joints, no other is chosen."""
        every = replace(self, transmissions=(*self.transmissions, *found))
        return every.excluding((effect, cause.joint) for effect in transmissions() for cause in found)


def find_causes(
    model: Arm, known: Sequence[Cause], recordings: Recordings, screened: Screened, progress: Progress
) -> CurrentDiagnosis:
    """Causes that the currents show conditional on the ``known`` ones of encoders and tracker."""
    search = Search(
        model=model,
        given=tuple(known),
        excluded=frozenset(cause.key for cause in known if not cause.by_tracker),
        recordings=recordings,
        screened=screened,
        progress=progress,
    )
    currents = _with_simulated_loops(search)
    held = as_held(currents.causes, currents.state.all_runs)
    currents = replace(currents, held=tuple(held), causes=[cause for cause in currents.causes if cause not in held])
    if currents.axis or currents.arm.uncertainty is not None:
        return currents
    state = currents.state
    return replace(
        currents,
        causes=with_rise_at_rest(currents.causes, state.all_runs, state.terms),
        near_rest=tuple(with_rise_at_rest(currents.near_rest, state.all_runs, state.terms)),
    )


def _with_simulated_loops(search: Search) -> CurrentDiagnosis:
    """The search; for recordings without noise repeated with the causes in the simulated loops.

    Without noise, the error of the method itself exceeds that of the instruments; a closed loop of the model on the
    same demands has the same error, which is subtracted (``simulated_loop``).
    """
    search = search.simulating(search.arm)
    currents = _repeated_search(search)
    for _ in range(LOOPS):
        again = search.simulating(extend(currents.base, currents.causes))
        if not _loops_differ(search.screened, again.screened, currents.residuals.runs):
            break
        search, currents = again, _repeated_search(again)
    return currents


def _loops_differ(before: Screened, after: Screened, runs: Sequence[Run]) -> bool:
    """Whether the residuals of the simulated loops of any recording differ by more than ``SETTLED``."""
    for was, now, run in zip(before.known_noise, after.known_noise, runs):
        of_loops = [0.0 if known.loop is None else known.loop.residual for known in (was, now)]
        moved = (of_loops[1] - of_loops[0]) / run.deviation
        if np.any(np.sqrt(np.mean(moved**2, axis=0)) > SETTLED):
            return True
    return False


def _repeated_search(search: Search) -> CurrentDiagnosis:
    """The search, repeated with every cause that is found outside it."""
    excluded = search.excluded
    search, currents = _with_smoothing_velocities(search)
    search.progress("judging friction near rest")
    search, currents = _with_friction_in_place(search, currents)
    excluded |= {cause.key for cause in search.near_rest}
    friction = friction_near_rest(currents, search.recordings, excluded)
    if friction.causes:
        search = search.with_near_rest(friction.causes)
        currents = _with_confirmed_triggers(search)
    if (of_recordings := _by_recording(search, currents)) is not None:
        # resonances are not searched for: that needs closed loops of one arm in all recordings
        return of_recordings
    search, currents = _with_lost_rows(search, currents)
    search, currents = _with_resonances(search, currents)
    # with the gap in the arm, the noise of the residual includes the uncertain instants of contact
    if not search.transmissions and (found := gaps(currents, search.excluded)):
        search, currents = _with_transmissions(search, currents, found)
    return currents if search.transmissions else replace(currents, undetermined=tuple(friction.undetermined))


def _with_smoothing_velocities(search: Search) -> tuple[Search, CurrentDiagnosis]:
    """The search, repeated with another smoothing velocity while an effect that it chose only imitates one."""
    currents = _with_confirmed_triggers(search)
    while currents.axis is None and (smoothing := other_smoothing(currents.state, currents.causes)) is not None:
        search = replace(search, model=smoothing.of(search.model)).excluding([smoothing.cause])
        currents = _with_confirmed_triggers(search)
    return search, currents


def _with_friction_in_place(search: Search, currents: CurrentDiagnosis) -> tuple[Search, CurrentDiagnosis]:
    """Both, with a law of friction near rest in the place of several causes of one joint, if it explains as much."""
    if not (laws := friction_in_place(currents, search.excluded)):
        return search, currents
    simpler = search.with_near_rest(laws)
    again = _with_confirmed_triggers(simpler)
    fewer = len(again.causes) + len(laws) < len(currents.causes)
    if fewer and again.state.energy.held_out <= AS_MUCH * currents.state.energy.held_out:
        return simpler, again
    return search, currents


def _with_resonances(search: Search, currents: CurrentDiagnosis) -> tuple[Search, CurrentDiagnosis]:
    """Both, repeated with every spring and gap that closed loops show."""
    search.progress("searching for transmission resonances in closed loop")
    recordings = search.recordings
    while has_dynamics(search.model):
        if (found := resonance_in_loop(currents, recordings, search.transmissions)) is None:
            break
        search, currents = _with_transmissions(search, currents, [found])
    return _estimated_together(search, currents) if len(search.transmissions) > 1 else (search, currents)


def _with_transmissions(
    search: Search, currents: CurrentDiagnosis, found: Sequence[Cause]
) -> tuple[Search, CurrentDiagnosis]:
    """The search with these springs and gaps as known causes too, and what it finds."""
    search, keys = search.with_transmissions(found), {cause.key for cause in found}
    terms = [term for term in currents.state.terms if (term.name, term.joint) not in keys]
    return search, _searched(search, confirmed(realigned(search.residuals(), terms), terms))


def _estimated_together(search: Search, currents: CurrentDiagnosis) -> tuple[Search, CurrentDiagnosis]:
    """Springs and gaps, each estimated again with all others known: joints oscillate together."""
    for place, cause in enumerate(search.transmissions):
        others = [one for one in search.known if one is not cause]
        again = transmission_in_place(extend(search.model, [*others, *currents.causes]), search.recordings, cause)
        if again is not None:
            estimated = [*search.transmissions]
            estimated[place] = again
            search = replace(search, transmissions=tuple(estimated))
    return _with_transmissions(search, currents, ())


def _with_lost_rows(search: Search, currents: CurrentDiagnosis) -> tuple[Search, CurrentDiagnosis]:
    """Both, repeated with the currents realigned if closed loops show that rows of currents were lost."""
    search.progress("searching for lost rows in closed loop")
    if (lost := rows_lost_in_loop(currents, search.recordings)) is None:
        return search, currents
    event = replace(event_of(lost.losses, currents.residuals.runs), gain=lost.gain)
    search = replace(search, screened=with_rows_put_back(search.screened, lost.losses, event))
    return search, _with_confirmed_triggers(search)


def _with_confirmed_triggers(search: Search) -> CurrentDiagnosis:
    """The search, repeated if dropped triggers are found in its residual, or turn out to be another effect."""
    residuals = search.residuals()
    currents = _searched(search, residuals)
    if (behind := realigned(residuals, currents.state.terms)) is not residuals:
        currents = _searched(search, behind)
    if (as_recorded := confirmed(currents.residuals, currents.state.terms)) is not currents.residuals:
        currents = _searched(search, as_recorded)
    return currents


def _searched(search: Search, residuals: Residuals) -> CurrentDiagnosis:
    """One search in the residuals of the recordings (held-out ones last), on a single axis also at the full rate."""
    fitted, two_fold = len(search.recordings.fit), search.recordings.two_fold
    samples = residuals.samples[:fitted], residuals.samples[fitted:]
    temperatures = [run.arm.temperatures for run in residuals.runs]
    axis = axis_side(search.arm, samples, two_fold=two_fold, temperatures=temperatures)
    if axis is None:
        return _searched_given(search, residuals, None)
    by_axis = _searched_given(search, residuals, axis)
    # the single-axis search has neither changes of inertia nor aliased setpoint ripple
    wider = any(load_changes(run) or run.folded.any() for run in residuals.runs)
    if not (wider or by_axis.selection.unexplained.structures):
        return by_axis
    by_arm = _searched_given(search, residuals, None)
    if wider and not (by_arm.selection.unexplained.structures or above_noise(by_arm.state)):
        return by_arm
    energies = [one.state.energy.held_out for one in (by_axis, by_arm)]
    return by_axis if energies[0] <= energies[1] else by_arm


def _searched_given(search: Search, residuals: Residuals, axis: AxisSide | None) -> CurrentDiagnosis:
    """The search conditional on the causes of a single ``axis``; None: the search that every arm gets.

    Repeated without what all joints show alike along their acceleration, where sampling may have put it there; or with
    all of it, where that is more than sampling may put there.
    """
    found = _searched_once(search, residuals, axis)
    if (share := folded_alike(found.state)) is not None:
        residuals = replace(residuals, runs=with_folding(residuals.runs, share))
        found = _searched_once(search, residuals, axis)
    if not (joints := beyond_folding(found.state)):
        return found
    return _searched_once(search, replace(residuals, runs=resolved(residuals.runs, joints)), axis)


def _searched_once(search: Search, residuals: Residuals, axis: AxisSide | None) -> CurrentDiagnosis:
    """One search conditional on the causes of a single ``axis``."""
    arm, recordings = search.arm, search.recordings
    fitted = len(recordings.fit)
    search.progress("computing the columns of every effect")
    every = _candidates(search, residuals)
    ripples = tuple(c for c in every if order_of(c) is not None)
    runs, data = residuals.runs, _datasets(residuals.runs, recordings)
    library = Library((c for c in every if order_of(c) is None), data)
    of_axis, base = [from_axis(cause, arm) for cause in axis.causes] if axis else [], arm
    if axis and of_axis:
        # the search continues in their residual
        base = replace(arm, joints=axis.held_out.arm.joints)
        runs = [replace(run, arm=replace(base, temperatures=run.arm.temperatures)) for run in runs]
        terms = extend(base, of_axis).effects[len(arm.effects) :]
        data = _datasets(runs, recordings).map(lambda part: replace(part, y=dataset_with(part, terms)))
    free = [Split(*pair) for pair in zip(free_columns(data.fit, arm), free_columns(data.held_out, arm))]
    data, free = bounded(data, free)
    searched, ripples = (library, ripples) if axis is None else (Library((), data), ())
    model = Currents(arm, data, searched, free, ripples, search.excluded, model_uncertainty(arm, data, ripples))
    selection, causes = tenable_causes(model, recordings, runs[fitted:], search.progress)
    return CurrentDiagnosis(
        arm=arm,
        residuals=residuals,
        base=base,
        library=library,
        ripples=ripples,
        selection=selection,
        axis=axis,
        causes=with_harmonics(causes, arm) + of_axis,
        shortage=shortage(selection) if axis is None else None,
        near_rest=search.near_rest,
        transmissions=search.transmissions,
    )


def _candidates(search: Search, residuals: Residuals) -> list[Candidate]:
    """Candidates that may be chosen; those that depend on temperature only if recordings can show it."""
    arm, fitted = search.arm, len(search.recordings.fit)
    if not has_dynamics(arm):
        return []
    cold = {j for j in range(1, len(arm) + 1) if not_warmed(residuals.runs[:fitted], residuals.runs[fitted:], j)}
    every = [c for c in (*candidates(arm), *of_shafts(arm)) if c.key not in search.excluded]
    return [c for c in every if not (is_of_gravity(c, arm) or (depends(c.effect) and c.joint in cold))]


def _by_recording(search: Search, currents: CurrentDiagnosis) -> CurrentDiagnosis | None:
    """The search with causes whose values differ between recordings, if only these explain the residual."""
    if currents.axis:
        return None

    def again(runs: Sequence[Run], taken: Set[EffectKey]) -> CurrentDiagnosis:
        search.progress("comparing the recordings with each other")
        refused = taken | set(currents.selection.refuted)
        return _searched(search.excluding(refused), replace(currents.residuals, runs=list(runs)))

    if (result := per_recording(currents, currents.residuals.runs, again)) is None:
        return None
    trial, values = result
    state, others = currents.state, trial.state.terms
    return replace(trial, per_recording=tuple(cause_of(one, values, state, others) for one in values))


def _datasets(runs: Sequence[Run], recordings: Recordings) -> Split[Dataset]:
    fitted = len(recordings.fit)
    return Split(dataset_of(runs[:fitted]), dataset_of(runs[fitted:]), recordings.two_fold)
