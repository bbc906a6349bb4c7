"""A measurement model whose state is the tuple of its chosen candidates, scored one at a time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

from diagnosis.selection.candidate import Candidate
from identification.selection import MeasurementModel, Score

Chosen = tuple[Candidate, ...]


class CandidateModel(MeasurementModel[Candidate, Chosen]):
    """What link encoders and a single axis have in common: the coefficients follow from the chosen candidates."""

    @abstractmethod
    def best(self, chosen: Sequence[Candidate]) -> list[Candidate]:
        """Every effect that is not chosen, at the nonlinear parameters that fit best conditional on the chosen."""

    @abstractmethod
    def score(self, candidate: Candidate, chosen: Sequence[Candidate]) -> Score[Candidate]:
        """One candidate conditional on those chosen, on held-out data."""

    def start(self) -> Chosen:
        """Nothing chosen."""
        return ()

    def chosen(self, state: Chosen) -> Chosen:
        """The candidates of a state."""
        return state

    def scores(self, state: Chosen) -> list[Score[Candidate]]:
        """All candidates of ``best``."""
        return [self.score(candidate, state) for candidate in self.best(state)]

    def without(self, candidate: Candidate, state: Chosen) -> Chosen:
        """Without the candidate."""
        return tuple(c for c in state if c is not candidate)

    def conditional(self, candidate: Candidate, without: Chosen, state: Chosen) -> Score[Candidate]:
        """One candidate conditional on all others."""
        return self.score(candidate, without)

    def needed(self, score: Score[Candidate], state: Chosen) -> bool:
        """Whether the share that it explains still matters."""
        return score.share > (self.limits.kept_gain or 0.0)
