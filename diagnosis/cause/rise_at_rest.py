"""Break-away friction that rises with the time at rest."""

from __future__ import annotations

from dataclasses import dataclass

RISES = 3.0
"""Standard deviations by which the rise of a break-away level must differ from zero to be significant."""


@dataclass(frozen=True, kw_only=True)
class RiseAtRest:
    """How the break-away level rises with the time at rest: by ``value`` in ``unit`` for ten times as long.

    std                of ``value``; both None: too few rests, or all of nearly the same length
    rests              break-aways that show it, after rests of ``shortest`` to ``longest`` s
    reference          s at rest after which the level is that of its cause
    slip               rad (m) that a joint slides until its hump is over; contacts are renewed over no less
    """

    unit: str
    rests: int
    shortest: float
    longest: float
    value: float | None = None
    std: float | None = None
    reference: float | None = None
    slip: float | None = None

    @property
    def determined(self) -> bool:
        """Whether the rise differs significantly from zero."""
        return self.value is not None and self.std is not None and self.value > RISES * self.std
