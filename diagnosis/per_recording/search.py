"""The search for causes of which no one value serves all recordings, together with those of the arm.

Where the causes that serve all recordings leave structure, or their values by single recordings contradict each other,
the cause that is contradicted most, or a ``settable`` effect, gets a value per recording. Everything else is searched
beside whatever such values explain (``diagnosis.residual.run.with_free``): neither can take what belongs to the other.
The next cause that is contradicted, or would explain most of what is left, then gets such values as well. They are
named if nothing is left but noise, no other cause is contradicted, and each of them is; and if they leave no more than
what serves all recordings does, by as much as matters: a value of each recording's own is no loss.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from typing import Protocol, TypeVar

import numpy as np

from arm_model import EffectTerm
from arm_model.effects import CATALOGUE, same_columns
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.columns import columns
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.currents.search import Selection
from diagnosis.measurements.currents.state import State
from diagnosis.per_recording.candidates import MATTERS, contradicted, noise_alone, promising
from diagnosis.per_recording.values import ValuesPerRecording, values_per_recording
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.run import Run, with_free
from diagnosis.selection.candidate import Candidate

MOST = 3
"""Causes with values per recording, at most: each has its coefficients once per recording, and many follow anything."""
STARTS = 3
"""Effects with which the search may begin, at most: each costs one search of all recordings or more."""
REDUCED = 0.9
"""Share of the squared residual to which a further cause with such values must bring it."""
ROUNDS = 2
"""Searches in which values per recording and the causes of the arm settle in the exact model."""


class _Searched(Protocol):
    """The result of a search; see ``CurrentDiagnosis``."""

    @property
    def selection(self) -> Selection: ...


S = TypeVar("S", bound=_Searched)
Search = Callable[[Sequence[Run], Set[EffectKey]], S]
"""A search in the residuals of runs, of none of some effects."""


def per_recording(currents: S, runs: Sequence[Run], search: Search[S]) -> tuple[S, list[ValuesPerRecording]] | None:
    """The search with values per recording for some causes, and these; None unless they explain everything.

    currents: what one value for all recordings shows; runs: its recordings, the fitted ones first.
    """
    state = currents.selection.state
    worst = contradicted(state)
    if worst is None and not currents.selection.unexplained.structures:
        return None
    given = promising(state, others=state.terms) if state.terms else []
    starts = [*([worst] if worst is not None else []), *given, *promising(state)]
    for first in list(dict.fromkeys(starts))[:STARTS]:
        grown = _grown(first, state, runs, search)
        found = None if grown is None else _in_exact_model(*grown, state, runs, search)
        if found is not None and _leaves_no_more(found[0].selection.state, state):
            return found
    return None


def _leaves_no_more(trial: State, state: State) -> bool:
    """Whether values per recording leave no more of all rows than one value for all does, by what matters."""
    return sum(trial.energy) - sum(state.energy) <= MATTERS * sum(part.rows for part in state.data)


def _grown(
    first: Candidate, state: State, runs: Sequence[Run], search: Search[S]
) -> tuple[list[Candidate], list[EffectTerm]] | None:
    """The candidates, beginning with ``first``, that need values per recording to leave noise only; causes beside them.

    None if something always remains.
    """
    several, before = [first], sum(state.energy)
    while True:
        values = values_per_recording(several, state)
        if not _all_exist(values, state):
            return None
        free = [
            with_free(with_own(run, [own.terms[k] for own in values]), _columns(several, run))
            for k, run in enumerate(runs)
        ]
        selection = search(free, _taken(several)).selection
        energy = sum(selection.state.energy)
        further = contradicted(selection.state)
        if further is None and noise_alone(selection.state) and not selection.unexplained.structures:
            return several, selection.state.terms
        if len(several) == MOST or energy > REDUCED * before:
            return None
        more = [further] if further is not None else promising(state, 1, several, selection.state.terms)
        if not more:
            return None
        several, before = [*several, *more], energy


def _in_exact_model(
    several: Sequence[Candidate], others: Sequence[EffectTerm], state: State, runs: Sequence[Run], search: Search[S]
) -> tuple[S, list[ValuesPerRecording]] | None:
    """The search with the values of every recording, beside ``others``, in the exact model; None where more is left."""
    values = values_per_recording(several, state, others)
    for _ in range(ROUNDS):
        if not _all_exist(values, state):
            return None
        trial = search([with_own(run, [own.terms[k] for own in values]) for k, run in enumerate(runs)], _taken(several))
        selection = trial.selection
        # causes of the arm are not causes of single recordings
        values = values_per_recording(several, state, selection.state.terms)
        if len(contradicting := [own.candidate for own in values if own.contradict]) < len(several):
            return _in_exact_model(contradicting, selection.state.terms, state, runs, search) if contradicting else None
        if (
            noise_alone(selection.state)
            and not selection.unexplained.structures
            and contradicted(selection.state) is None
        ):
            return trial, values
    return None


def _all_exist(values: Sequence[ValuesPerRecording], state: State) -> bool:
    """Whether in every recording there can be an arm with all of the values."""
    return all(exists(state.model.arm, terms) for terms in zip(*(own.terms for own in values)))


def _columns(several: Sequence[Candidate], run: Run) -> np.ndarray:
    """(m, n, k) A."""
    return np.concatenate([columns(c, run) for c in several], axis=-1)


def _taken(several: Sequence[Candidate]) -> set[EffectKey]:
    """Effects at their joints that explain the same, or contain it."""
    wider = {c: [effect.name for effect in CATALOGUE.values() if c.effect in effect.special_cases] for c in several}
    return {(name, c.joint) for c in several for name in (c.effect, *same_columns(c.definition), *wider[c])}
