"""An effect that is an event or a spectral line in raw rows: removed from the recordings before the rest is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnosis.cause import Estimate


@dataclass(frozen=True, kw_only=True)
class Gain:
    """What an event explains where it shows.

    Rms of that error without and with it, in ``unit``, at ``joint`` (from 1), and the probability that the fall is
    chance.
    """

    before: float
    after: float
    unit: str
    joint: int
    p: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Event:
    """An effect found in raw rows.

    joint       from 1; None: of the whole arm
    recordings  those that show it, by index
    gain        what it explains there; None: it shows in closed loop only
    of_joints   of an event of the whole arm that shows joint by joint: its parameters at each joint (from 1)
    """

    effect: str
    joint: int | None
    parameters: list[Estimate]
    evidence: str
    recordings: tuple[int, ...]
    gain: Gain | None = None
    of_joints: Mapping[int, list[Estimate]] = field(default_factory=dict)
