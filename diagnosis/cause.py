"""One named cause, whatever showed it: the currents, raw rows, one axis seen finely, two encoders or a tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from arm_model.description import Arm, EffectTerm
from arm_model.servo import fixed_gains
from diagnosis.measurements.currents.estimates import Estimate

SUREST = 0.98
"""Confidence that no recording lifts a cause above: of 120 names on a bank of cases that were as sure of themselves, 117 were right."""


@dataclass(frozen=True)
class Cause:
    """One accepted effect.

    confidence     that it is there, it or another of its ``group``
    before, after  rms of its joint's held-out residual in ``signal`` without and with it, in ``unit``; of a tracker's points, of a coordinate
    group          effects and joints that this data cannot tell from it, itself first; separate_by: what would
    felt_at        the joint (from 1) where it shows most; 0: at none more than at another
    of_arm         False for a fact about the instruments that the model has no place for
    """

    effect: str
    joint: int | None
    parameters: list[Estimate]
    confidence: float
    before: float
    after: float
    group: tuple[tuple[str, int | None], ...]
    separate_by: str | None
    evidence: str
    felt_at: int
    unit: str
    signal: Literal["current", "angle", "link angle", "tracker", "closed loop"] = "current"
    of_arm: bool = True

    @property
    def by_tracker(self) -> bool:
        """Whether tracked points show it."""
        return self.signal == "tracker"


def confidence_of(p: float) -> float:
    """Confidence in a cause whose gain is chance with probability p."""
    return float(min(max(1.0 - p, 0.0), SUREST))


def together(causes: Sequence[Cause], tracked: Sequence[Cause]) -> list[Cause]:
    """Causes of the currents and those that a tracker saw: what both name is said once, with the tracker's parameters where it names the same,
    and a group of the tracker's that holds what the currents name is that."""
    named = {(cause.effect, cause.joint): cause for cause in causes}
    alone = []
    for one in tracked:
        same = next((named[key] for key in one.group if key in named), None)
        if same is None:
            alone.append(one)
        else:
            key = same.effect, same.joint
            parameters = one.parameters if key == (one.effect, one.joint) else same.parameters
            sentence = f"{same.evidence}; the tracker agrees: {one.evidence}"
            named[key] = replace(same, parameters=parameters, group=(key,), separate_by=None, evidence=sentence)
    return [*alone, *named.values()]


def extend(arm: Arm, causes: Sequence[Cause]) -> Arm:
    """The model with every cause as an effect of its own, beside those it had."""
    terms = list(arm.effects)
    for cause in (one for one in causes if one.of_arm):
        terms.append(EffectTerm(cause.effect, cause.joint, {p.name: float(p.value) for p in cause.parameters}))
    return replace(fixed_gains(arm), effects=tuple(terms))
