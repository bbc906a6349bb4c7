"""Stepwise selection on held-out data: forward with a joint refit, each step followed by backward elimination.

The one search of this code base. A ``MeasurementModel`` says what its candidates are, what one gains on held-out data
conditional on those chosen already, and how a choice is refitted; which candidate enters, which leaves and when the
search ends is decided here.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy import stats

from arm_io.progress import Progress, Step
from arm_io.types import Array
from identification.selection.limits import Limits

C = TypeVar("C", bound=Hashable)
S = TypeVar("S")


@dataclass(frozen=True, kw_only=True)
class Score(Generic[C]):
    """One candidate conditional on those chosen.

    gain          fall of the squared held-out residual, in the model's unit
    share         gain over what was left without the candidate, where the model says
    p             probability that the gain is chance
    blocks        (blocks,) gain of each block of held-out rows
    by_joint      (n,) gain of each joint, where the model says
    coefficients  (k,) of its columns
    shown         how many of them the fitted rows determine, where the model says
    """

    candidate: C
    gain: float
    p: float
    blocks: Array = field(repr=False)
    coefficients: Array = field(repr=False)
    by_joint: Array = field(repr=False, default_factory=lambda: np.zeros(0))
    share: float = 0.0
    shown: int | None = None

    @property
    def determined(self) -> int:
        """Number of coefficients that the data says something of: a column of zeros has the coefficient 0."""
        given = int(np.count_nonzero(self.coefficients))
        return given if self.shown is None else min(given, self.shown)


class MeasurementModel(Protocol[C, S]):
    """What ``select`` searches: candidates C, and states S, each a set of chosen candidates fitted together."""

    limits: Limits

    def start(self) -> S:
        """The state in which nothing is chosen."""
        ...

    def chosen(self, state: S) -> Sequence[C]:
        """The candidates of a state, in the order of acceptance."""
        ...

    def scores(self, state: S) -> Sequence[Score[C]]:
        """Scores of all candidates that are not excluded, conditional on those chosen.

        Each is taken at the nonlinear parameters that fit best.
        """
        ...

    def admissible(self, score: Score[C], state: S) -> bool:
        """Whether a candidate is physically admissible and matters."""
        ...

    def entered(self, score: Score[C], admissible: Sequence[Score[C]], state: S) -> S | None:
        """The state with the candidate, refined and refitted; None if it is then not admissible.

        admissible: all that might have entered.
        """
        ...

    def without(self, candidate: C, state: S) -> S:
        """The state without one of its candidates, the others refitted."""
        ...

    def conditional(self, candidate: C, without: S, state: S) -> Score[C]:
        """One chosen candidate conditional on all others (``without``)."""
        ...

    def needed(self, score: Score[C], state: S) -> bool:
        """Whether a chosen candidate still matters conditional on all others."""
        ...

    def extends(self, score: Score[C]) -> bool:
        """Whether a candidate extends one that is chosen: these are a family of tests of their own."""
        return False

    def tolerance(self, score: Score[C], best: Score[C]) -> float:
        """By how much less than the best a candidate may gain and be its equal."""
        return 0.0

    def stalled(self, state: S) -> S | None:
        """The state with several candidates that enter together where none enters alone; None where none do."""
        return None

    def after_round(self, state: S) -> S:
        """The state after a round: refined, or seen by data that has been corrected."""
        return state


def select(model: MeasurementModel[C, S], progress: Progress = lambda sentence: None, start: S | None = None) -> S:
    """The candidates that explain the data together.

    start: the state to begin with; None: that in which nothing is chosen.
    """
    state = eliminated = model.start() if start is None else start
    for number in range(1, model.limits.max_causes + 1):
        progress(Step("looking for causes", number - 1, detail=f"cause {number}"))
        entered = forward(model, state)
        if entered is None and state is eliminated:
            break
        proposed = state if entered is None else entered
        eliminated = proposed if model.limits.kept_gain is None else eliminate(model, proposed)
        if set(model.chosen(eliminated)) == set(model.chosen(state)):
            break
        state = model.after_round(eliminated)
    return state


def forward(model: MeasurementModel[C, S], state: S) -> S | None:
    """The state with the best admissible candidate; None where none enters."""
    scores = model.scores(state)
    q = _by_family([score.p for score in scores], [model.extends(score) for score in scores])
    admissible = [
        score
        for score, q_score in zip(scores, q)
        if _significant(float(q_score), model.limits.fdr) and model.admissible(score, state)
    ]
    for score in _ranked(model, admissible)[: model.limits.attempts]:
        entered = model.entered(score, admissible, state)
        if entered is not None:
            return entered
    return model.stalled(state)


def eliminate(model: MeasurementModel[C, S], state: S, *, fdr: float | None = None, tests: int = 0) -> S:
    """Backward elimination: while the others make one superfluous, the least needed is removed.

    fdr, tests: those are removed as well whose gain conditional on all others is not significant among so many
    candidates.
    """
    while len(chosen := model.chosen(state)) > (0 if fdr is not None else 1):
        removed = [model.without(candidate, state) for candidate in chosen]
        scores = [model.conditional(candidate, less, state) for candidate, less in zip(chosen, removed)]
        chance = [0.0 if fdr is None else score.p * tests / len(scores) for score in scores]
        superfluous = [
            not model.needed(score, state) or (fdr is not None and p > fdr) for score, p in zip(scores, chance)
        ]
        least = max(range(len(scores)), key=lambda k: (superfluous[k], chance[k], -scores[k].gain))
        if not superfluous[least]:
            break
        state = removed[least]
    return state


def _by_family(p: Sequence[float], extends: Sequence[bool]) -> Array:
    """(k,) false-discovery rates of probabilities (k,), over those that extend a chosen candidate, and over the others.

    Of what is chosen already, a few extensions are asked for; the number of all other effects says nothing of them
    (hierarchical testing: Yekutieli, JASA 103, 2008).
    """
    q, of_extension = np.array(p, float), np.array(extends, bool)
    for family in (of_extension, ~of_extension):
        if family.any():
            q[family] = stats.false_discovery_control(q[family])
    return q


def _significant(q: float, fdr: float | None) -> bool:
    return fdr is None or q < fdr


def _ranked(model: MeasurementModel[C, S], scores: Sequence[Score[C]]) -> list[Score[C]]:
    """The largest gain first; of those that are equal to the best, the one with the fewest coefficients.

    First of all, coefficients that the data says something of: a link of which one inertia is seen is no richer than a
    rotor. Of these two, the rotor, which has no others.
    """
    if not scores:
        return []
    best = max(scores, key=lambda score: score.gain)

    def rank(score: Score[C]) -> tuple[int, float, int]:
        equal = score.gain >= best.gain - model.tolerance(score, best)
        return (0, score.determined, len(score.coefficients)) if equal else (1, -score.gain, 0)

    return sorted(scores, key=rank)
