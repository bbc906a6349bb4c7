"""One rival of a cause in its place, if that makes all later causes of its joint superfluous."""

from __future__ import annotations

from dataclasses import replace

from diagnosis.measurements.currents.replacement.trial import clearly_worse
from diagnosis.measurements.currents.state import State


def one_for_several(state: State) -> State:
    """The state with a rival of a cause in its place that makes all later causes of its joint superfluous.

    A simpler cause is chosen first among those whose gains differ by less than first-order columns are wrong. What it
    leaves of a richer one, other causes then imitate. Not where ``exchanged`` would take these causes again.
    """
    model, noise = state.model, float(state.data.held_out.rows)
    for c in state.chosen:
        place = state.chosen.index(c) if c in state.chosen else len(state.chosen)
        later = [one for one in state.chosen[place + 1 :] if c.joint in (one.joint, None)]
        for rival in (score.candidate for score in state.rivals.get(c.key, ()) if later):
            others = [one for one in state.chosen if one is not c and one not in later]
            if rival.terms or rival.key in model.excluded or rival.key in {one.key for one in state.chosen}:
                continue
            trial = model.refitted([*others[:place], rival, *others[place:]], {**state.rivals, rival.key: ()})
            as_well = trial.energy.held_out - state.energy.held_out < model.limits.min_gain * noise
            if as_well and not clearly_worse(trial, state, rival.joint):
                own = [one for one in state.rivals[c.key] if one.candidate.key != rival.key]
                state = replace(trial, rivals={**state.rivals, rival.key: own})
                break
    return state
