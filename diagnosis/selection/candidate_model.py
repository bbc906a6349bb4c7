"""A measurement model whose state is the tuple of its chosen candidates, scored one at a time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TypeVar

from identification.selection import MeasurementModel, Score

C = TypeVar("C")


class CandidateModel(MeasurementModel[C, tuple[C, ...]]):
    """Of link encoders, a single axis and a floating base: the coefficients follow from the chosen candidates."""

    @abstractmethod
    def best(self, chosen: Sequence[C]) -> list[C]:
        """Every effect that is not chosen, at the nonlinear parameters that fit best conditional on the chosen."""

    @abstractmethod
    def score(self, candidate: C, chosen: Sequence[C]) -> Score[C]:
        """One candidate conditional on those chosen, on held-out data."""

    def start(self) -> tuple[C, ...]:
        """Nothing chosen."""
        return ()

    def chosen(self, state: tuple[C, ...]) -> tuple[C, ...]:
        """The candidates of a state."""
        return state

    def scores(self, state: tuple[C, ...]) -> list[Score[C]]:
        """All candidates of ``best``."""
        return [self.score(candidate, state) for candidate in self.best(state)]

    def entered(self, score: Score[C], admissible: Sequence[Score[C]], state: tuple[C, ...]) -> tuple[C, ...]:
        """With the candidate, whatever else might have entered."""
        return (*state, score.candidate)

    def without(self, candidate: C, state: tuple[C, ...]) -> tuple[C, ...]:
        """Without the candidate."""
        return tuple(c for c in state if c is not candidate)

    def conditional(self, candidate: C, without: tuple[C, ...], state: tuple[C, ...]) -> Score[C]:
        """One candidate conditional on all others."""
        return self.score(candidate, without)

    def beyond_model(self, candidate: C, others: tuple[C, ...]) -> bool:
        """Whether a candidate is significant conditional on others, within the stated uncertainty of the model."""
        return True

    def needed(self, score: Score[C], state: tuple[C, ...]) -> bool:
        """Whether a candidate still matters conditional on all others, which may have entered after it."""
        matters = score.share > (self.limits.kept_gain or 0.0)
        return matters and self.beyond_model(score.candidate, self.without(score.candidate, state))
