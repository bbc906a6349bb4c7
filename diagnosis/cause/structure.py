"""What a diagnosis cannot name: structure that no effect explains, effects that are not detectable."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.cause.evidence import Signal

NO_VARIABLE = "no single variable"
"""``Structure.against`` of a residual above the noise that no variable predicts."""


@dataclass(frozen=True)
class Structure:
    """Unexplained structure: the share of the variance of a held-out residual that is predictable from a variable.

    joint    from 1; None: of tracked points
    against  name of the variable alone; "no single variable" where none predicts the residual
    size     its size in words, ``4 mm in 12 s``; empty where the share says enough
    fit_only  the fitted recordings alone show it: there is no held-out share
    """

    signal: Signal
    joint: int | None
    against: str
    share: float
    size: str = ""
    fit_only: bool = False

    def words(self) -> str:
        """``time (4 mm in 12 s)``."""
        return f"{self.against} ({self.size})" if self.size else self.against


@dataclass(frozen=True)
class Undetectable:
    """An effect that the recordings cannot show, with the reason and a detection experiment."""

    effect: str
    joint: int | None
    why: str
    experiment: str
