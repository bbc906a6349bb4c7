"""Which causes may have values per recording: those that contradict themselves, and those that explain more by them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import EffectTerm
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.currents.state import State
from diagnosis.per_recording.single_recordings import columns_of_recordings, estimated_alone, residuals_of
from diagnosis.per_recording.values import ValuesPerRecording, fitted_values, residuals_with
from diagnosis.remainder.against_noise import ratios
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.contradiction import CHANCE, chance_of
from diagnosis.selection.design import Pair
from diagnosis.selection.regression import INDEPENDENT
from identification.selection import scaled_lstsq

MATTERS = 0.1
"""Share of the noise energy of a joint's rows by which own values must explain more than one value for all."""
EQUAL = 0.02
"""Relative difference of gains below which the one with fewer coefficients is tried first."""
IMPOSSIBLE = 2.0
"""std by which a load of one recording must be negative to be none."""
QUIET = 1.5
"""Times the noise that may remain at a joint: values per recording also follow what no effect explains, in part."""


def contradicted(state: State) -> Candidate | None:
    """The chosen candidate whose values by single recordings contradict each other most; None where all agree."""
    chosen, runs = state.chosen, state.all_runs
    if not chosen or len(runs) < 2 or state.data.two_fold:
        return None
    columns = columns_of_recordings([*(state.model.columns(c) for c in chosen), *state.model.free], state)
    largest = np.concatenate([[c.largest(k) for k in range(len(own))] for c, own in zip(chosen, state.coefficients)])
    unknown = np.concatenate([largest, np.zeros(columns[0].shape[1] - len(largest))])
    seen = [estimated_alone(run, x, y, unknown) for run, x, y in zip(runs, columns, residuals_of(state))]
    chances, first = dict[Candidate, float](), 0
    for c, own in zip(chosen, state.coefficients):
        chances[c] = chance_of(seen, slice(first, first + len(own)))
        first += len(own)
    worst = min(chances, key=lambda c: chances[c])
    return worst if chances[worst] < CHANCE / len(chosen) else None


def promising(
    state: State, limit: int = 2, given: Sequence[Candidate] = (), others: Sequence[EffectTerm] = ()
) -> list[Candidate]:
    """Settable effects that explain most by values of their own, where one value for all explains much less.

    Conditional on values per recording of those ``given``, with ``others`` in the arm, and on nothing else: another
    cause may have been chosen for what the recordings differ in. Whether the values contradict each other shows when
    nothing else is missing.
    """
    if state.model.data.two_fold:
        return []
    rows, missed = sum(part.rows for part in state.model.data), residuals_with(state, others)
    taken = {*state.model.excluded, *(c.key for c in given)}
    tried = [c for c in state.model.library if c.definition.settable and c.key not in taken]

    def judged(c: Candidate) -> ValuesPerRecording | None:
        own = fitted_values([*given, c], state, others, missed)[-1]
        more = own.gains.sum() - (0.0 if given else _common_gain(state.model.columns(c), state, missed))
        return own if more > MATTERS * rows and exists_in_all(own, state) else None

    contradicting = [own for own in in_parallel(judged, tried) if own is not None]
    best = max((float(own.gains.sum()) for own in contradicting), default=0.0)

    def rank(own: ValuesPerRecording) -> tuple[int, float]:
        gain = float(own.gains.sum())
        return (0, len(own.alone[0].values)) if gain > (1 - EQUAL) * best else (1, -gain)

    return [own.candidate for own in sorted(contradicting, key=rank)[:limit]]


def noise_alone(state: State) -> bool:
    """Whether no joint has more than ``QUIET`` times the noise left, in fitted and in held-out recordings."""
    parts = zip(state.runs, state.residual)
    return all(one.ratio <= QUIET for runs, residual in parts for one in ratios(runs, residual))


def exists_in_all(own: ValuesPerRecording, state: State) -> bool:
    """Whether the values of every recording give a possible arm, and no load is negative."""
    masses = [p for values in own.parameters for p in values if p.name == "mass"]
    possible = all(p.value > -IMPOSSIBLE * p.std for p in masses)
    return possible and all(exists(state.model.arm, [term]) for term in own.terms)


def _common_gain(pair: Pair, state: State, missed: Sequence[Array]) -> float:
    """Fall of the squared residual of all recordings, ``missed``, by one value for all."""
    x, y = np.concatenate(columns_of_recordings([pair], state)), np.concatenate(missed)
    return float(np.sum(y**2) - np.sum((y - x @ scaled_lstsq(x, y, INDEPENDENT)) ** 2))
