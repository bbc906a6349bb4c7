"""Causes in the currents, conditional on what is known of an arm.

The search and its verification, friction near rest, values that differ between recordings, and resonances in closed
loop: each of the last three is found in what the search leaves, and the search is repeated with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property

from arm_io.types import Progress
from arm_model import Arm
from arm_model.effects import CATALOGUE, Variable
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, Structure, extend
from diagnosis.closed_loop.comparison import with_smoothing_velocities
from diagnosis.closed_loop.friction import friction_in_loop, has_state, with_estimates_of
from diagnosis.closed_loop.resonance import transmission_resonance, transmissions
from diagnosis.measurements.currents.causes import from_axis
from diagnosis.measurements.currents.chatter import chattering_gaps
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, bounded, dataset_of, dataset_with, free_columns
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.model_errors import model_uncertainty
from diagnosis.measurements.currents.search import Found
from diagnosis.measurements.currents.shortage import Shortage, shortage
from diagnosis.measurements.currents.structure.basis_functions import TWO_FACED
from diagnosis.measurements.near_rest.friction import Friction, friction_causes
from diagnosis.measurements.near_rest.passages import known_speed
from diagnosis.measurements.near_rest.time_at_rest import with_rise_at_rest
from diagnosis.measurements.single_axis.causes import AxisSide, axis_side, with_sharp_friction
from diagnosis.per_recording.search import per_recording
from diagnosis.per_recording.values import cause_of
from diagnosis.residual.expected_current import has_dynamics
from diagnosis.residual.run import Run
from diagnosis.residual.warmth import depends, not_warmed
from diagnosis.screening.cleaned import Screened
from diagnosis.screening.residuals import Residuals, confirmed, realigned, residuals_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from diagnosis.selection.harmonics import with_harmonics
from diagnosis.selection.ripple_orders import of_shafts, order_of
from diagnosis.verification.smoothing_velocity import other_smoothing
from diagnosis.verification.tenable import tenable_causes
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Named:
    """What the currents of recordings name, conditional on what is known of the arm.

    arm, sight  the model with all that is known of it, and the residuals of the recordings under it
    base        the arm that the causes extend
    library     every candidate's columns; ripples: candidates that have columns only where they stand out of the
                residual
    found       what the search chose; axis: what a single axis with a fine encoder shows
    causes      of the search or of the axis
    near_rest   friction found where joints turn or creep; transmissions: a spring or a gap found in closed loop, or the
                gaps of the search. ``arm`` has both
    undetermined  joints that show friction near rest whose size the recordings do not determine
    shortage    what the held-out recordings are too short for
    own         causes whose values differ between recordings; the runs have them, ``base`` has not
    """

    arm: Arm
    sight: Residuals
    base: Arm
    library: Library
    ripples: tuple[Candidate, ...]
    found: Found
    axis: AxisSide | None
    causes: list[Cause]
    shortage: Shortage | None = None
    near_rest: tuple[Cause, ...] = ()
    transmissions: tuple[Cause, ...] = ()
    undetermined: tuple[Structure, ...] = ()
    own: tuple[Cause, ...] = ()

    @property
    def beside(self) -> list[Cause]:
        """Causes that were found beside the search, and that ``arm`` has."""
        return [*self.near_rest, *self.transmissions]


Recordings = Split[Sequence[Recording]]


@dataclass(frozen=True, kw_only=True)
class Search:
    """One search for causes in the currents of recordings.

    model, known  the model, and causes that are known before the search
    excluded      effects that it may not choose
    """

    model: Arm
    known: tuple[Cause, ...]
    excluded: frozenset[EffectKey]
    recordings: Recordings
    screened: Screened
    progress: Progress

    @cached_property
    def arm(self) -> Arm:
        """The model with the known causes."""
        return extend(self.model, self.known) if self.known else self.model

    def residuals(self) -> Residuals:
        """Of the recordings under ``arm``."""
        return residuals_of(self.arm, self.screened, self.progress)

    def knowing(self, causes: Sequence[Cause], excluded: Iterable[EffectKey]) -> Search:
        """The same with more known causes, and more effects that it may not choose."""
        return replace(self, known=(*self.known, *causes), excluded=self.excluded.union(excluded))


def named_causes(
    model: Arm, known: Sequence[Cause], recordings: Recordings, screened: Screened, progress: Progress
) -> Named:
    """Causes that the currents show conditional on the ``known`` ones of encoders and tracker."""
    search = Search(
        model=model,
        known=tuple(known),
        excluded=frozenset(cause.key for cause in known if not cause.by_tracker),
        recordings=recordings,
        screened=screened,
        progress=progress,
    )
    named = _named(search)
    if named.axis or named.arm.uncertainty is not None:
        return named
    state = named.found.state
    runs = [run for part in state.data for run in part.runs]
    return replace(
        named,
        causes=with_rise_at_rest(named.causes, runs, state.terms),
        near_rest=tuple(with_rise_at_rest(named.near_rest, runs, state.terms)),
    )


def _named(search: Search) -> Named:
    """The search, repeated with whatever is found beside it."""
    recordings, progress, given = search.recordings, search.progress, search.excluded
    named = _settled(search)
    while named.axis is None and (other := other_smoothing(named.found.state, named.causes)) is not None:
        # searched again with that smoothing velocity, and without the law that explained nothing else
        search = replace(search, model=other.of(search.model), excluded=search.excluded | {other.cause})
        named = _settled(search)
    progress("judging friction near rest")
    friction = _near_rest(named, recordings, given)
    near_rest, undetermined = tuple(friction.causes), tuple(friction.undetermined)
    if near_rest:
        # the others are searched for again, with that friction in the model
        search = search.knowing(near_rest, (cause.key for cause in near_rest))
        named = replace(_settled(search), near_rest=near_rest)
    if (of_recordings := _by_recording(search, named)) is not None:
        # the closed loops of a search for resonances are of one arm for all recordings
        return of_recordings
    progress("searching for transmission resonances in closed loop")
    resonance = _resonance(named, recordings) if has_dynamics(search.model) else None
    # of a gap that the arm has, residuals know how uncertain they are while teeth meet
    found = (resonance,) if resonance else _gaps(named, search.excluded)
    if not found:
        return replace(named, undetermined=undetermined)
    # ... and with what was found
    search = search.knowing(found, ((effect, one.joint) for effect in transmissions() for one in found))
    terms = [term for term in named.found.state.terms if (term.name, term.joint) not in {one.key for one in found}]
    sight = confirmed(realigned(search.residuals(), terms), terms)
    return replace(_searched(search, sight), near_rest=near_rest, transmissions=found)


def _settled(search: Search) -> Named:
    """What is named once dropped triggers are found, or found to be another effect."""
    sight = search.residuals()
    named = _searched(search, sight)
    if (behind := realigned(sight, named.found.state.terms)) is not sight:
        named = _searched(search, behind)
    if (as_recorded := confirmed(named.sight, named.found.state.terms)) is not named.sight:
        named = _searched(search, as_recorded)
    return named


def _near_rest(named: Named, recordings: Recordings, excluded: Set[EffectKey]) -> Friction:
    """Friction that shows where joints turn or creep, beside what the search named.

    Of an arm whose model is exact: what an identified model leaves over there is not known.
    """
    state = named.found.state
    if named.axis or named.arm.uncertainty is not None or not named.library:
        return Friction([], [])
    taken = [*excluded, *(cause.key for cause in named.causes)]
    # what load or position predict is another law: friction is judged beside any function of them
    given: dict[int, list[Variable]] = {}
    for one in named.found.unexplained.structures:
        if one.joint is not None and one.against in TWO_FACED:
            given.setdefault(one.joint, []).append(Variable(one.against))
    found = friction_causes(state.data.map(lambda part: part.runs), state.terms, taken, tuple(named.library), given)
    in_loop = _in_loop(named, recordings, [*taken, *(cause.key for cause in found.causes)])
    return replace(found, causes=[*found.causes, *in_loop])


def _in_loop(named: Named, recordings: Recordings, taken: Sequence[EffectKey]) -> list[Cause]:
    """The same by closed loops, at joints whose encoder does not show the speed that currents are judged at.

    What the search named there of currents is judged again, and estimated by both.
    """
    runs = [run for part in named.found.state.data for run in part.runs]
    coarse = [j for j in range(1, len(named.arm) + 1) if not any(known_speed(run, j) for run in runs)]
    if not coarse:
        return []
    every = [replace(r, q=q, i=i) for r, (_, q, i) in zip((*recordings.fit, *recordings.held_out), named.sight.samples)]
    again = {cause.key: cause for cause in named.causes if cause.joint in coarse and has_state(cause.effect)}
    beside = [cause for cause in named.causes if cause.key not in again]
    found = friction_in_loop(extend(named.base, beside), every, coarse, set(taken) - set(again))
    return [with_estimates_of(cause, again[cause.key]) if cause.key in again else cause for cause in found]


def _searched(search: Search, sight: Residuals) -> Named:
    """Names causes in the residuals of the recordings, those held out last."""
    arm, recordings, excluded, progress = search.arm, search.recordings, search.excluded, search.progress
    first, parts = len(recordings.fit), recordings.two_fold
    progress("computing the columns of every effect")
    every = (*candidates(arm), *of_shafts(arm)) if has_dynamics(arm) else ()
    cold = {j for j in range(1, len(arm) + 1) if not_warmed(sight.runs[:first], sight.runs[first:], j)}
    every = tuple(c for c in every if c.key not in excluded and not (depends(c.effect) and c.joint in cold))
    ripples = tuple(c for c in every if order_of(c) is not None)
    runs, data = sight.runs, _datasets(sight.runs, first, parts)
    library = Library((c for c in every if order_of(c) is None), data)
    warm = [run.arm.temperatures for run in sight.runs]
    axis = axis_side(arm, (sight.samples[:first], sight.samples[first:]), two_fold=parts, temperatures=warm)
    of_axis, base = [from_axis(one, arm) for one in axis.causes] if axis else [], arm
    if of_axis:
        # the search continues in their residual
        base = with_sharp_friction(arm, sight.samples)
        runs = [replace(run, arm=replace(base, temperatures=run.arm.temperatures)) for run in runs]
        terms = extend(base, of_axis).effects[len(arm.effects) :]
        data = _datasets(runs, first, parts).map(lambda part: replace(part, y=dataset_with(part, terms)))
    free = [Split(*pair) for pair in zip(free_columns(data.fit, arm), free_columns(data.held_out, arm))]
    data, free = bounded(data, free)
    searched, ripples = (library, ripples) if axis is None else (Library((), data), ())
    model = Currents(arm, data, searched, free, ripples, excluded, model_uncertainty(arm, data))
    found, causes = tenable_causes(model, recordings, runs[first:], progress)
    return Named(
        arm=arm,
        sight=sight,
        base=base,
        library=library,
        ripples=ripples,
        found=found,
        axis=axis,
        causes=with_harmonics(causes, arm) + of_axis,
        shortage=shortage(found) if axis is None else None,
    )


def _by_recording(search: Search, named: Named) -> Named | None:
    """What is named with causes whose values differ between recordings, if that explains what nothing else does."""
    if named.axis:
        return None

    def again(runs: Sequence[Run], taken: Set[EffectKey]) -> Named:
        search.progress("comparing the recordings with each other")
        return _searched(search.knowing((), taken), replace(named.sight, runs=list(runs)))

    if (result := per_recording(named, named.sight.runs, again)) is None:
        return None
    trial, values = result
    state, others = named.found.state, trial.found.state.terms
    return replace(trial, own=tuple(cause_of(own, values, state, others) for own in values))


def _datasets(runs: Sequence[Run], first: int, two_fold: bool) -> Split[Dataset]:
    return Split(dataset_of(runs[:first]), dataset_of(runs[first:]), two_fold)


def _resonance(named: Named, recordings: Recordings) -> Cause | None:
    """A spring or a gap that closed loops show: in the place of one that the search named, or in addition."""
    springs: list[Cause | None] = [one for one in named.causes if one.effect in transmissions()]
    for spring in springs or [None]:
        arm = with_smoothing_velocities(
            extend(named.base, [one for one in named.causes if one is not spring]), recordings.fit
        )
        joints = [spring.joint] if spring and spring.joint else range(1, len(arm) + 1)
        if (cause := transmission_resonance(arm, recordings.fit, recordings.held_out, joints, spring)) is not None:
            return cause
    return None


def _gaps(named: Named, excluded: Set[EffectKey]) -> tuple[Cause, ...]:
    """The gaps that the search named, and those whose teeth chatter.

    Of an arm whose model is exact: an error of its load moves the instant at which teeth part.
    """
    if named.axis:
        return ()
    found = tuple(one for one in named.causes if CATALOGUE[one.effect].gap is not None)
    if named.arm.uncertainty is not None or not named.library:
        return found
    state, taken = named.found.state, {*excluded, *(cause.key for cause in named.causes)}
    return (*found, *chattering_gaps(state.data.map(lambda part: part.runs), state.terms, taken))
