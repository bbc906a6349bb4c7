"""What a diagnosis says: causes with parameters, structure that no effect explains, effects that are not detectable.

This module imports no measurement, so that all of them may import it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from enum import StrEnum

from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE
from arm_model.servo import fixed_gains

EffectKey = tuple[str, int | None]
"""An effect of the catalogue and its joint (from 1); None: of the whole arm."""

MAX_CONFIDENCE = 0.98
"""Largest confidence in a cause by 1 - p alone: of 297 causes named in cases with known answers 284 were right
(docs/diagnosis-evidence.md)."""


class Signal(StrEnum):
    """The signal whose residual shows a cause."""

    CURRENT = "current"
    ANGLE = "angle"
    LINK_ANGLE = "link angle"
    TRACKER = "tracker"
    CLOSED_LOOP = "closed loop"


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


@dataclass(frozen=True)
class Remainder:
    """What no effect explains beside a cause that explains nearly all of the excess over the noise at its joint.

    share: rms of what is left over that of the cause's excess; against: variables that it depends on.
    """

    share: float
    against: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class LostRows:
    """Rows that channels of a recording lost at one instant.

    file   name of the recording
    joint  whose counter lost them, alone (from 1); None: all counters, or all currents
    row    of the recorded columns: the first after the loss, from 0; time: s of that instant
    count  number of rows; negative: of angles
    row_std  of ``row``; a jump of an angle is at one row, a change of lag is seen over many
    """

    file: str
    joint: int | None
    row: int
    time: float
    count: int
    row_std: float = 0.0


@dataclass(frozen=True, kw_only=True)
class EncoderJump:
    """Counts that an encoder missed at one instant.

    file   name of the recording; joint: from 1
    row    the first with the offset, from 0; time: s of that row
    counts  gained; negative: lost; std: of their number
    """

    file: str
    joint: int
    row: int
    time: float
    counts: int
    std: float


@dataclass(frozen=True, kw_only=True)
class Support:
    """The evidence for a cause, from which its stated confidence follows (``diagnosis.confidence``).

    significance  1 - p of its gain on held-out data, at most MAX_CONFIDENCE
    gain          rms of the held-out residual without it, over that with it, at its joint
    largest       largest such gain of all causes
    determined    largest ratio of a parameter to its standard deviation, without the error of its law
    left          rms residual at that joint with all causes in the model, over the noise
    unexplained   signals in which structure remains that no effect explains
    """

    significance: float
    gain: float
    largest: float
    determined: float
    left: float
    unexplained: int


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


_PEOPLE = ("coulomb", "stribeck")


def in_words(key: EffectKey) -> str:
    """An effect and its joint in words: ``backlash of joint 2``; names of persons keep their capital."""
    effect, joint = key
    words = " ".join(part.capitalize() if part in _PEOPLE else part for part in effect.split("_"))
    return f"{words} of joint {joint}" if joint else words


def confidence_of(p: float) -> float:
    """Confidence in a cause whose gain has the p-value p."""
    return float(min(max(1.0 - p, 0.0), MAX_CONFIDENCE))


def merge(causes: Sequence[Cause], tracked: Sequence[Cause], of_model: Set[EffectKey] = frozenset()) -> list[Cause]:
    """Causes of the currents and those of the tracker, each named once.

    A cause that both name has the parameters of the tracker, and those that only the currents show; one ``of_model``
    has those with which the currents were judged. An ambiguity group of the tracker that contains a cause of the
    currents is that cause.
    """
    by_key = {cause.key: cause for cause in causes}
    only_tracked = []
    for of_tracker in tracked:
        counterpart = next((by_key[key] for key in of_tracker.group if key in by_key), None)
        if counterpart is None:
            only_tracked.append(of_tracker)
            continue
        parameters = counterpart.parameters
        if counterpart.key == of_tracker.key and counterpart.key not in of_model:
            shown = {p.name for p in of_tracker.parameters}
            parameters = [*of_tracker.parameters, *(p for p in counterpart.parameters if p.name not in shown)]
        sentence = f"{counterpart.evidence}; the tracker agrees: {of_tracker.evidence}"
        by_key[counterpart.key] = replace(
            counterpart, parameters=parameters, group=(counterpart.key,), separate_by=None, evidence=sentence
        )
    return [*only_tracked, *by_key.values()]


def extend(arm: Arm, causes: Sequence[Cause]) -> Arm:
    """The model with every cause as an additional effect."""
    terms = [term for cause in causes if cause.of_arm for term in cause.terms]
    return replace(fixed_gains(arm), effects=(*arm.effects, *terms))


def without_cause(extended: Arm, cause: Cause) -> Arm:
    """An extended model without the effects of a cause."""
    return replace(extended, effects=tuple(term for term in extended.effects if term not in cause.terms))
