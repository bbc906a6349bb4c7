"""The causes that a search finds and nothing refutes: in the place of a refuted one, the search is repeated.

A cause is refuted if its gain does not matter in the final model, if no parameter of it differs significantly from
zero, if no body has its sizes, or if the held-out closed loop has a smaller error without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scipy import stats

from arm_io.types import Progress
from arm_model import Arm
from arm_model.effects import CATALOGUE
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, Remainder, extend
from diagnosis.closed_loop.comparison import refuted, with_smoothing_velocities
from diagnosis.measurements.currents.causes import of_candidate
from diagnosis.measurements.currents.estimates import estimates_of, together
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.possible import impossible
from diagnosis.measurements.currents.search import Selection, refitted_without, search, without_spurious
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.dominant import dominant, remainder_of
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import Unexplained
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.harmonics import is_further_order
from diagnosis.verification.final_gain import FinalModel, with_significance
from identification.selection import Split


def tenable_causes(
    model: Currents, recordings: Split[Sequence[Recording]], runs: Sequence[Run], progress: Progress
) -> tuple[Selection, list[Cause]]:
    """Causes that the search finds and closed loops on held-out ``recordings`` do not refute.

    In the place of a refuted one it searches again. runs: residuals of the held-out ones.
    """
    refused, bases = list[EffectKey](), Bases(*model.data)
    selection, final = _with_structure(_searched(model, refused, progress), bases, progress)
    while True:
        progress("estimating parameters")
        causes = causes_of(selection)
        progress("judging in closed loop")
        state = selection.state
        needless = (final if final.state is state else FinalModel(state, causes)).needless
        removed = _untenable(state, causes, recordings, runs) if needless is None else needless
        if removed is None:
            return selection, with_significance(state, causes)
        candidate, others = state.chosen[removed], [*state.chosen[:removed], *state.chosen[removed + 1 :]]
        if needless is None and not is_further_order(candidate, others):
            refused.append(candidate.key)
            if len(refused) <= LIMITS.searched_again:
                # another effect may explain the same
                selection, final = _with_structure(_searched(model, refused, progress), bases, progress)
                continue
        selection = without_spurious(refitted_without(state, candidate), bases, selection.refuted)


def _significant_together(state: State, index: int) -> bool:
    """Whether parameters of a link, none of which is significant alone, are so together."""
    several = state.chosen[index].link_parameters > 0
    return several and together(state, index) > LIMITS.significant_sizes


def _searched(model: Currents, refused: list[EffectKey], progress: Progress) -> FinalModel:
    """What the search finds without the ``refused``, to which it adds causes that their exact laws disprove."""
    while True:
        final = _final_model(search(replace(model, excluded=model.excluded | set(refused)), progress))
        if (index := final.disproved) is None or len(refused) >= LIMITS.searched_again:
            return final
        refused.append(final.state.chosen[index].key)


def _final_model(state: State) -> FinalModel:
    return FinalModel(state, causes_of(Selection(state, Unexplained([], [], {}))))


def _with_structure(found: FinalModel, bases: Bases, progress: Progress) -> tuple[Selection, FinalModel]:
    """The causes that were found, and the structure that they leave unexplained; the model that was judged last.

    Causes that the final model does not need are removed first, so that structure is searched for once. Where there is
    some it is searched for beside all of them: it decides which are no names for it, and what the others then gain.
    """
    progress("searching for unexplained structure")
    fewer = found
    while (removed := fewer.needless) is not None:
        fewer = _final_model(refitted_without(fewer.state, fewer.state.chosen[removed]))
    selection = without_spurious(fewer.state, bases)
    if fewer is not found and (selection.state is not fewer.state or selection.unexplained.structures):
        selection = without_spurious(found.state, bases)
    return selection, fewer


def causes_of(selection: Selection) -> list[Cause]:
    """The causes that a search found, in its order, with parameters."""
    state = selection.state
    strongest = dominant(state) if selection.unexplained.structures else []
    return [
        replace(of_candidate(c, values, state), remainder=_remainder(c, selection) if c in strongest else None)
        for c, values in zip(state.chosen, estimates_of(state))
    ]


def _remainder(candidate: Candidate, selection: Selection) -> Remainder | None:
    """What is left beside the dominant cause of a joint, where that has structure."""
    against = [
        structure.against for structure in selection.unexplained.structures if structure.joint == candidate.joint
    ]
    share = remainder_of(candidate, selection.state) if against else 0.0
    return Remainder(share, tuple(against)) if share > 0.0 else None


def insignificant(arm: Arm, causes: Sequence[Cause]) -> int | None:
    """The first cause whose size does not differ significantly from zero, corrected for the number of its parameters.

    Its size: any of its linear parameters, or the inverse of one such as a stiffness. None where the model says how
    well it is known, which is judged by ``within_model``.
    """
    for index, cause in enumerate(causes if arm.uncertainty is None else ()):
        # the inverse of a stiffness is as many std from zero as the stiffness itself
        effect = CATALOGUE[cause.effect]
        sizes = {p.name for p in effect.linear} | {p.name for p in effect.parameters if p.inverse}
        values = [p for p in cause.parameters if p.name in sizes]
        # of k parameters without any effect, one exceeds it as often as one alone exceeds the limit
        limit = float(stats.norm.isf(stats.norm.sf(LIMITS.significant_sizes) / max(len(values), 1)))
        if values and all(abs(p.value) < limit * p.std for p in values):
            return index
    return None


def _untenable(
    state: State, causes: list[Cause], recordings: Split[Sequence[Recording]], runs: Sequence[Run]
) -> int | None:
    """The first cause that no body has, none of whose parameters is significant, or that the closed loop refutes."""
    arm = state.model.arm
    if not causes:
        return None
    if (index := impossible(arm, causes)) is not None:
        return index
    index = insignificant(arm, causes)
    if index is not None and not _significant_together(state, index):
        return index
    full = with_smoothing_velocities(extend(arm, causes), recordings.fit)
    smoothed = arm.with_sign_velocities(full.joint_array("sign_velocity"))
    without_each = [extend(smoothed, [other for other in causes if other is not cause]) for cause in causes]
    return refuted(full, without_each, [cause.felt_at or 1 for cause in causes], recordings.held_out, runs)
