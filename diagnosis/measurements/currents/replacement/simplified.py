"""What was selected, made simpler: the rules of replacement in their order."""

from __future__ import annotations

from diagnosis.measurements.currents.replacement.fewer_coefficients import fewer_coefficients
from diagnosis.measurements.currents.replacement.special_cases import special_cases
from diagnosis.measurements.currents.replacement.two_for_one import two_for_one
from diagnosis.measurements.currents.state import State

RULES = (fewer_coefficients, two_for_one, special_cases)


def simplified(state: State) -> State:
    """The state with fewer or simpler effects in the place of others, if they predict held-out rows as well."""
    if not state.chosen:
        return state
    # as each trial: to first order, an error of the gain takes its share of the noise with it
    state = state.model.refitted(state.chosen, state.rivals)
    for rule in RULES:
        state = rule(state)
    return state
