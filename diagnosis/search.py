"""One search for causes in the currents of recordings, conditional on what is known of an arm.

Four functions, each of which repeats the next one where its causes show that the residuals were of another kind:

    searched          triggers were dropped (residuals are realigned), or were not (they are as recorded)
    searched_in       a single axis explains less at its full rate than as one joint of an arm
    _beside_folding   sampling put an inertia into the acceleration, or too little to explain what is there
    _one_selection    a stepwise selection among the columns of all effects, and its verification
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm_io.types import Progress
from arm_model import Arm
from diagnosis.cause import Cause, EffectKey, Structure, extend
from diagnosis.closed_loop.resonance import transmissions
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.currents.causes import from_axis
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, bounded, dataset_of, dataset_with, free_columns
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.model_errors import model_uncertainty
from diagnosis.measurements.currents.search import above_noise, by_fitted_rows
from diagnosis.measurements.currents.shortage import shortage
from diagnosis.measurements.single_axis.causes import AxisSide, axis_side, load_changes
from diagnosis.measurements.single_axis.columns import AxisSamples
from diagnosis.residual.expected_current import has_dynamics
from diagnosis.residual.run import Run
from diagnosis.residual.warmth import depends, not_warmed
from diagnosis.screening.cleaned import Screened, with_simulated_loops
from diagnosis.screening.residuals import Residuals, confirmed, realigned, residuals_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from diagnosis.selection.harmonics import with_harmonics
from diagnosis.selection.ripple_orders import is_of_gravity, of_shafts, order_of
from diagnosis.verification.beyond_folding import beyond_folding, resolved
from diagnosis.verification.folded_alike import folded_alike, with_folding
from diagnosis.verification.tenable import tenable_causes
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Search:
    """One search for causes in the currents of recordings.

    model          without any cause
    given          causes that encoders and tracker have shown
    near_rest, transmissions  causes that were found outside the stepwise selection (``CurrentDiagnosis``)
    undetermined   friction near rest whose size the recordings do not determine
    excluded       effects that the search may not choose
    """

    model: Arm
    given: tuple[Cause, ...]
    near_rest: tuple[Cause, ...] = ()
    transmissions: tuple[Cause, ...] = ()
    undetermined: tuple[Structure, ...] = ()
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
        """The same with more springs and gaps as known causes: of their joints, no other is chosen.

        What friction near rest left undetermined was judged without them.
        """
        every = replace(self, transmissions=(*self.transmissions, *found), undetermined=())
        return every.excluding((effect, cause.joint) for effect in transmissions() for cause in found)


def searched(search: Search) -> CurrentDiagnosis:
    """The search, repeated if dropped triggers are found in its residual, or turn out to be another effect."""
    residuals = search.residuals()
    currents = searched_in(search, residuals)
    if (behind := _behind(currents)) is not residuals:
        currents = searched_in(search, behind)
    if (as_recorded := confirmed(currents.residuals, currents.state.terms)) is not currents.residuals:
        currents = searched_in(search, as_recorded)
    return currents


def _behind(currents: CurrentDiagnosis) -> Residuals:
    """The residuals of a search, realigned if triggers were dropped.

    They are looked for beside its causes, and where none are found beside what the fitted rows show: held-out rows
    contradict that while they are not where they belong.
    """
    residuals, state = currents.residuals, currents.state
    behind = realigned(residuals, state.terms)
    if behind is not residuals or currents.axis or (shown := by_fitted_rows(state)) is state:
        return behind
    return realigned(residuals, shown.terms)


def searched_in(search: Search, residuals: Residuals) -> CurrentDiagnosis:
    """One search in the residuals of the recordings (held-out ones last), on a single axis also at the full rate."""
    samples = [AxisSamples(*one, run.arm.temperatures) for one, run in zip(residuals.samples, residuals.runs)]
    axis = axis_side(search.arm, search.recordings.cut(samples))
    if axis is None:
        return _beside_folding(search, residuals, None)
    by_axis = _beside_folding(search, residuals, axis)
    # the single-axis search has neither changes of inertia nor aliased setpoint ripple
    wider = any(load_changes(run) or run.folded.any() for run in residuals.runs)
    if not (wider or by_axis.selection.unexplained.structures):
        return by_axis
    by_arm = _beside_folding(search, residuals, None)
    if wider and not (by_arm.selection.unexplained.structures or above_noise(by_arm.state)):
        return by_arm
    energies = [one.state.energy.held_out for one in (by_axis, by_arm)]
    return by_axis if energies[0] <= energies[1] else by_arm


def _beside_folding(search: Search, residuals: Residuals, axis: AxisSide | None) -> CurrentDiagnosis:
    """The search conditional on the causes of a single ``axis``; None: the search that every arm gets.

    Repeated without what all joints show alike along their acceleration, where sampling may have put it there; or with
    all of it, where that is more than sampling may put there.
    """
    found = _one_selection(search, residuals, axis)
    if (share := folded_alike(found.state)) is not None:
        residuals = replace(residuals, runs=with_folding(residuals.runs, share))
        found = _one_selection(search, residuals, axis)
    if not (joints := beyond_folding(found.state)):
        return found
    return _one_selection(search, replace(residuals, runs=resolved(residuals.runs, joints)), axis)


def _one_selection(search: Search, residuals: Residuals, axis: AxisSide | None) -> CurrentDiagnosis:
    """One stepwise selection and its verification, conditional on the causes of a single ``axis``."""
    arm, base, recordings, runs = search.arm, search.arm, search.recordings, residuals.runs
    search.progress("computing the columns of every effect")
    every, data = _candidates(search, residuals), _datasets(runs, recordings)
    ripples = tuple(c for c in every if order_of(c) is not None)
    library = Library((c for c in every if order_of(c) is None), data)
    of_axis = [from_axis(cause, arm) for cause in axis.causes] if axis else []
    if axis and of_axis:
        base = replace(arm, joints=axis.held_out.arm.joints)
        runs = [replace(run, arm=replace(base, temperatures=run.arm.temperatures)) for run in runs]
        data = _left_by(of_axis, base, _datasets(runs, recordings))
    free = [Split(*pair) for pair in zip(free_columns(data.fit, arm), free_columns(data.held_out, arm))]
    data, free = bounded(data, free)
    columns, ripples = (library, ripples) if axis is None else (Library((), data), ())
    model = Currents(arm, data, columns, free, ripples, search.excluded, model_uncertainty(arm, data, ripples))
    selection, causes = tenable_causes(model, recordings, recordings.cut(runs).held_out, search.progress)
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
        undetermined=search.undetermined,
    )


def _left_by(causes: Sequence[Cause], base: Arm, data: Split[Dataset]) -> Split[Dataset]:
    """The data with the residual that causes leave of recordings of the arm ``base``."""
    terms = extend(base, causes).effects[len(base.effects) :]
    return data.map(lambda part: replace(part, y=dataset_with(part, terms)))


def _candidates(search: Search, residuals: Residuals) -> list[Candidate]:
    """Candidates that may be chosen; those that depend on temperature only if recordings can show it."""
    arm, runs = search.arm, search.recordings.cut(residuals.runs)
    if not has_dynamics(arm):
        return []
    cold = {j for j in range(1, len(arm) + 1) if not_warmed(runs.fit, runs.held_out, j)}
    inertia = np.mean([run.inertia.mean(axis=0) for run in residuals.runs], axis=0)
    every = [c for c in (*candidates(arm, inertia), *of_shafts(arm)) if c.key not in search.excluded]
    return [c for c in every if not (is_of_gravity(c, arm) or (depends(c.effect) and c.joint in cold))]


def _datasets(runs: Sequence[Run], recordings: Recordings) -> Split[Dataset]:
    return recordings.cut(runs).map(dataset_of)
