"""Fit set and held-out set of anything: recordings, rows, columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

T_co = TypeVar("T_co", covariant=True)
U = TypeVar("U")


@dataclass(frozen=True)
class Split(Generic[T_co]):
    """What causes are found in, and what they are judged by.

    two_fold: both are parts of the same recordings, and each is predicted from the other.
    """

    fit: T_co
    held_out: T_co
    two_fold: bool = False

    def __iter__(self) -> Iterator[T_co]:
        return iter((self.fit, self.held_out))

    def items(self) -> Iterator[tuple[str, T_co]]:
        """Both with the names that they have in results."""
        return iter((("fit", self.fit), ("held_out", self.held_out)))

    def folds(self) -> list[tuple[T_co, T_co]]:
        """(learned from, judged by): once, or of two parts of the same recordings both ways."""
        return [(self.fit, self.held_out), *([(self.held_out, self.fit)] if self.two_fold else [])]

    def map(self, function: Callable[[T_co], U]) -> Split[U]:
        """The function of either set."""
        return Split(function(self.fit), function(self.held_out), self.two_fold)

    def cut(self: Split[Sequence[object]], every: Sequence[U]) -> Split[Sequence[U]]:
        """One of ``every`` per item of these sequences, those of the fitted items first, as two sequences."""
        return Split(every[: len(self.fit)], every[len(self.fit) :], self.two_fold)
