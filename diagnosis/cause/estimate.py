"""An estimated parameter."""

from __future__ import annotations

from dataclasses import dataclass

ROUNDING = 1e-9
"""Relative standard deviation below which it counts as 0: no recording determines a value so well, it is rounding."""


@dataclass(frozen=True)
class Estimate:
    """One parameter of a cause: its value and standard deviation, both in ``unit``.

    std: 0 for a number that was chosen rather than estimated, and for a relative std below ``ROUNDING``. of_own: value
    over the same quantity of the model's own friction (1: it has doubled); None where it has none.
    """

    name: str
    value: float
    std: float
    unit: str
    of_own: float | None = None

    def __post_init__(self) -> None:
        if 0.0 < self.std < ROUNDING * abs(self.value):
            object.__setattr__(self, "std", 0.0)
