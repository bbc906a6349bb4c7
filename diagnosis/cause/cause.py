"""An accepted effect, with parameters, evidence and gain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from arm_model import EffectTerm
from arm_model.effects import CATALOGUE
from diagnosis.cause.effect_key import EffectKey, in_words
from diagnosis.cause.estimate import Estimate
from diagnosis.cause.evidence import Remainder, Signal, Support
from diagnosis.cause.rise_at_rest import RiseAtRest
from diagnosis.cause.row_events import EncoderJump, LostRows


@dataclass(frozen=True, kw_only=True, repr=False)
class Cause:
    """One accepted effect.

    joint          from 1; None: of the whole arm
    confidence     that it is there, it or another of its ``group``
    before, after  rms of its joint's held-out residual in ``signal`` without and with it, in ``unit``; of tracked
                   points, per coordinate
    group          ambiguity group: effects and joints that this data cannot distinguish from it, itself first
    separate_by    experiment that discriminates the group
    felt_at        the joint (from 1) with the largest fall of the residual; None: tracked points only
    of_arm         False for a fact about the instruments that the model has no place for
    of_recordings  parameters in each recording, by its file name, where no single value fits all recordings
    of_joints      of a cause of the whole rig that acts joint by joint: its parameters at each joint (from 1)
    harmonics      of a ripple: those of its own order, as effects of a model (``diagnosis.selection.harmonics``)
    remainder      what is left unexplained beside it; None: nothing, or it is not the dominant cause of its joint
    support        evidence that the confidence follows from; None: it is that of the gain alone
    lost_rows      of dropped triggers: every loss
    encoder_jumps  of an encoder: every jump
    rise_at_rest   of break-away friction: how its level depends on the time at rest; None: it was not judged
    deviations     standard deviations from zero with the model exact, and with its parameters free within their
                   stated uncertainty; None: the model states none
    """

    effect: str
    joint: int | None
    parameters: list[Estimate]
    confidence: float
    before: float
    after: float
    group: tuple[EffectKey, ...]
    evidence: str
    felt_at: int | None
    unit: str
    separate_by: str | None = None
    signal: Signal = Signal.CURRENT
    of_arm: bool = True
    of_joints: Mapping[int, list[Estimate]] = field(default_factory=dict)
    of_recordings: Mapping[str, list[Estimate]] = field(default_factory=dict)
    remainder: Remainder | None = None
    support: Support | None = None
    harmonics: tuple[EffectTerm, ...] = ()
    lost_rows: tuple[LostRows, ...] = ()
    encoder_jumps: tuple[EncoderJump, ...] = ()
    rise_at_rest: RiseAtRest | None = None
    deviations: tuple[float, float] | None = None

    def __repr__(self) -> str:
        sizes = ", ".join(f"{p.name} {p.value:.3g} (std {p.std:.2g}) {p.unit}" for p in self.parameters)
        return f"<Cause {in_words(self.key)}: {sizes}; confidence {self.confidence:.0%}>"

    @property
    def next_orders(self) -> tuple[str, ...]:
        """Next-order terms of its law that it has: ``hardening`` of a spring."""
        effect, names = CATALOGUE[self.effect], {p.name for p in self.parameters}
        return tuple(term for term in effect.terms if effect.of_term(term).name in names)

    @property
    def key(self) -> EffectKey:
        """Effect and joint."""
        return self.effect, self.joint

    @property
    def terms(self) -> tuple[EffectTerm, ...]:
        """The cause as effects of a model."""
        each: Iterable[tuple[int | None, list[Estimate]]] = self.of_joints.items() or [(self.joint, self.parameters)]
        own_terms = (EffectTerm(self.effect, joint, {p.name: float(p.value) for p in own}) for joint, own in each)
        return (*own_terms, *self.harmonics, *self._rising, *self._further_jumps)

    @property
    def _further_jumps(self) -> tuple[EffectTerm, ...]:
        """The other jumps of the recording that has the largest, which is in ``parameters``, as effects of a model."""
        if len(self.encoder_jumps) < 2:
            return ()
        largest_values = {p.name: float(p.value) for p in self.parameters}
        largest = max(self.encoder_jumps, key=lambda jump: abs(jump.counts))
        further = [jump for jump in self.encoder_jumps if jump.file == largest.file and jump is not largest]
        jumps = [{**largest_values, "counts": float(jump.counts), "time": jump.time} for jump in further]
        return tuple(EffectTerm(self.effect, self.joint, values) for values in jumps)

    @property
    def _rising(self) -> tuple[EffectTerm, ...]:
        """The rise of its level with the time at rest as an effect of a model; empty if it is not significant."""
        rise = self.rise_at_rest
        if rise is None or not rise.determined or rise.value is None or rise.reference is None or rise.slip is None:
            return ()
        effect, own = CATALOGUE[CATALOGUE[self.effect].rises_by], {p.name: p.value for p in self.parameters}
        values = own | {effect.linear[0].name: rise.value, "reference": rise.reference, "slip": rise.slip}
        return (EffectTerm(effect.name, self.joint, {p.name: float(values[p.name]) for p in effect.parameters}),)

    @property
    def by_tracker(self) -> bool:
        """Whether tracked points show it."""
        return self.signal is Signal.TRACKER
