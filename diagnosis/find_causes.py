"""Causes in the currents, conditional on what is known of an arm.

A search (``search``), and what it does not search for: every stage of ``STAGES`` looks for that in what the search
leaves, and the search is repeated with what the stage found.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Progress
from arm_model import Arm
from diagnosis.cause import Cause, EffectKey, extend
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.near_rest.time_at_rest import with_rise_at_rest
from diagnosis.outside_selection import (
    friction_in_place,
    friction_near_rest,
    gaps,
    resonance_in_loop,
    rows_lost_in_loop,
    transmission_in_place,
)
from diagnosis.per_recording.as_causes import cause_of
from diagnosis.per_recording.search import per_recording
from diagnosis.residual.expected_current import has_dynamics
from diagnosis.residual.run import Run
from diagnosis.screening.cleaned import Screened, with_rows_put_back
from diagnosis.screening.lost_rows.losses import event_of
from diagnosis.screening.residuals import confirmed, realigned
from diagnosis.search import Search, searched, searched_in
from diagnosis.verification.held_currents import as_held
from diagnosis.verification.smoothing_velocity import other_smoothing

LOOPS = 2
"""Searches with other simulated loops after the first, at most.

All causes are missing in the loops of the first. Those of the second have the causes, those of the third their sizes as
the second found them.
"""
AS_MUCH = 1.02
"""Squared held-out residual that fewer causes may leave, over that of more: 2 % is a std of 5000 squares of noise."""
LOOPS_DIFFER = 0.2
"""Std of the residual, rms, by which the residuals of closed loops must differ for another search.

It adds 4 % to the energy of the noise: less than half of what a cause must explain (``LIMITS.min_gain``).
"""


@dataclass(frozen=True)
class Found:
    """A search, and what it found.

    excluded  effects that no stage may choose: those that were known before the first search
    """

    search: Search
    currents: CurrentDiagnosis
    excluded: frozenset[EffectKey]

    def again(self, search: Search) -> Found:
        """The same with that search."""
        return replace(self, search=search, currents=searched(search))


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
    return _with_rise_at_rest(_without_held(_with_simulated_loops(search)))


def _with_simulated_loops(search: Search) -> CurrentDiagnosis:
    """All stages; for recordings without noise repeated with the causes in the simulated loops.

    Without noise, the error of the method itself exceeds that of the instruments; a closed loop of the model on the
    same demands has the same error, which is subtracted (``simulated_loop``).
    """
    search = search.simulating(search.arm)
    currents = _all_stages(search)
    for _ in range(LOOPS):
        again = search.simulating(extend(currents.base, currents.causes))
        if not _loops_differ(search.screened, again.screened, currents.residuals.runs):
            break
        search, currents = again, _all_stages(again)
    return currents


def _loops_differ(before: Screened, after: Screened, runs: Sequence[Run]) -> bool:
    """Whether the residuals of the simulated loops of any recording differ by more than ``LOOPS_DIFFER``."""
    for was, now, run in zip(before.known_noise, after.known_noise, runs):
        of_loops = [0.0 if known.loop is None else known.loop.residual for known in (was, now)]
        moved = (of_loops[1] - of_loops[0]) / run.deviation
        if np.any(np.sqrt(np.mean(moved**2, axis=0)) > LOOPS_DIFFER):
            return True
    return False


def _all_stages(search: Search) -> CurrentDiagnosis:
    """The search, repeated with what every stage finds outside it."""
    found = Found(search, searched(search), search.excluded)
    for stage in STAGES:
        found = stage(found)
        # what follows simulates closed loops of one arm in all recordings
        if found.currents.per_recording:
            break
    return found.currents


def _smoothing_velocities(found: Found) -> Found:
    """Another smoothing velocity of the friction, while an effect that the search chose only imitates one."""
    while (currents := found.currents).axis is None:
        if (smoothing := other_smoothing(currents.state, currents.causes)) is None:
            break
        search = found.search
        found = found.again(replace(search, model=smoothing.of(search.model)).excluding([smoothing.cause]))
    return found


def _friction_in_place(found: Found) -> Found:
    """Laws of friction near rest in the place of other causes of their joints, if they explain as much.

    They are fewer causes, or the same with all parameters.
    """
    search, currents = found.search, found.currents
    search.progress("judging friction near rest")
    if not (laws := friction_in_place(currents, search.excluded)):
        return found
    simpler = found.again(search.with_near_rest(laws))
    fewer = len(simpler.currents.causes) + len(laws) < len(currents.causes)
    same = {cause.key for cause in (*simpler.currents.causes, *laws)} == {cause.key for cause in currents.causes}
    as_much = simpler.currents.state.energy.held_out <= AS_MUCH * currents.state.energy.held_out
    return simpler if (fewer or same) and as_much else found


def _friction_near_rest(found: Found) -> Found:
    """Friction that shows where joints turn or creep."""
    search, currents = found.search, found.currents
    excluded = found.excluded.union(cause.key for cause in search.near_rest)
    friction = friction_near_rest(currents, search.recordings, excluded)
    known = replace(search.with_near_rest(friction.causes), undetermined=tuple(friction.undetermined))
    if friction.causes:
        return found.again(known)
    return replace(found, search=known, currents=replace(currents, undetermined=known.undetermined))


def _values_by_recording(found: Found) -> Found:
    """Causes whose values differ between recordings, if only these explain the residual."""
    search, currents = found.search, found.currents
    if currents.axis:
        return found

    def again(runs: Sequence[Run], taken: Set[EffectKey]) -> CurrentDiagnosis:
        search.progress("comparing the recordings with each other")
        refused = taken | set(currents.selection.refuted)
        return searched_in(search.excluding(refused), replace(currents.residuals, runs=list(runs)))

    if (result := per_recording(currents, currents.residuals.runs, again)) is None:
        return found
    trial, values = result
    state, others = currents.state, trial.state.terms
    causes = tuple(cause_of(one, values, state, others) for one in values)
    return replace(found, currents=replace(trial, per_recording=causes, undetermined=()))


def _lost_rows(found: Found) -> Found:
    """Rows of currents that closed loops show to be lost: the currents are realigned."""
    search, currents = found.search, found.currents
    search.progress("searching for lost rows in closed loop")
    if (lost := rows_lost_in_loop(currents, search.recordings)) is None:
        return found
    event = replace(event_of(lost.losses, currents.residuals.runs), gain=lost.gain)
    return found.again(replace(search, screened=with_rows_put_back(search.screened, lost.losses, event)))


def _resonances(found: Found) -> Found:
    """Springs and gaps that closed loops show."""
    found.search.progress("searching for transmission resonances in closed loop")
    while has_dynamics(found.search.model):
        search = found.search
        if (spring := resonance_in_loop(found.currents, search.recordings, search.transmissions)) is None:
            break
        found = _with_transmissions(found, [spring])
    return _estimated_together(found) if len(found.search.transmissions) > 1 else found


def _gaps(found: Found) -> Found:
    """Gaps that the search chose or whose teeth chatter, where no closed loop shows a spring or a gap.

    With the gap in the arm, the noise of the residual includes the uncertain instants of contact.
    """
    if found.search.transmissions or not (chosen := gaps(found.currents, found.search.excluded)):
        return found
    return _with_transmissions(found, chosen)


STAGES = (
    _smoothing_velocities,
    _friction_in_place,
    _friction_near_rest,
    _values_by_recording,
    _lost_rows,
    _resonances,
    _gaps,
)
"""What is found outside the search, in this order."""


def _with_transmissions(found: Found, transmissions: Sequence[Cause]) -> Found:
    """The search with more springs and gaps as known causes; the causes found so far align its residuals."""
    search, keys = found.search.with_transmissions(transmissions), {cause.key for cause in transmissions}
    terms = [term for term in found.currents.state.terms if (term.name, term.joint) not in keys]
    residuals = confirmed(realigned(search.residuals(), terms), terms)
    return replace(found, search=search, currents=searched_in(search, residuals))


def _estimated_together(found: Found) -> Found:
    """Springs and gaps, each estimated again with all others known: joints oscillate together."""
    search, causes = found.search, found.currents.causes
    for place, cause in enumerate(search.transmissions):
        others = [one for one in search.known if one is not cause]
        again = transmission_in_place(extend(search.model, [*others, *causes]), search.recordings, cause)
        if again is not None:
            estimated = [*search.transmissions]
            estimated[place] = again
            search = replace(search, transmissions=tuple(estimated))
    return _with_transmissions(replace(found, search=search), ())


def _without_held(currents: CurrentDiagnosis) -> CurrentDiagnosis:
    """Delays of the currents that are how rows show what servos hold are no causes."""
    held = as_held(currents.causes, currents.state.all_runs)
    return replace(currents, held=tuple(held), causes=[cause for cause in currents.causes if cause not in held])


def _with_rise_at_rest(currents: CurrentDiagnosis) -> CurrentDiagnosis:
    """Break-away friction with its dependence on the time at rest."""
    if not currents.by_exact_model:
        return currents
    runs, terms = currents.state.all_runs, currents.state.terms
    causes, near_rest = (with_rise_at_rest(some, runs, terms) for some in (currents.causes, currents.near_rest))
    return replace(currents, causes=causes, near_rest=tuple(near_rest))
