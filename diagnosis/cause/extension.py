"""Causes as effects of a model: the extended model."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from arm_model import Arm
from arm_model.servo import fixed_gains
from diagnosis.cause.cause import Cause
from diagnosis.cause.effect_key import EffectKey
from diagnosis.cause.estimate import Estimate


def merge(causes: Sequence[Cause], tracked: Sequence[Cause], of_model: Set[EffectKey] = frozenset()) -> list[Cause]:
    """Causes of the currents and those of the tracker, each named once.

    A cause that both name has the parameters of the tracker, and those that only the currents show; where the currents
    know all of them better, it has theirs. One ``of_model`` has those with which the currents were judged. An ambiguity
    group of the tracker that contains a cause of the currents is that cause.
    """
    by_key = {cause.key: cause for cause in causes}
    only_tracked = []
    for of_tracker in tracked:
        counterpart = next((by_key[key] for key in of_tracker.group if key in by_key), None)
        if counterpart is None:
            only_tracked.append(of_tracker)
            continue
        parameters = counterpart.parameters
        alike = counterpart.key == of_tracker.key and counterpart.key not in of_model
        if alike and not _known_better(counterpart.parameters, of_tracker.parameters):
            shown = {p.name for p in of_tracker.parameters}
            parameters = [*of_tracker.parameters, *(p for p in counterpart.parameters if p.name not in shown)]
        sentence = f"{counterpart.evidence}; the tracker agrees: {of_tracker.evidence}"
        by_key[counterpart.key] = replace(
            counterpart, parameters=parameters, group=(counterpart.key,), separate_by=None, evidence=sentence
        )
    return [*only_tracked, *by_key.values()]


def _known_better(ours: Sequence[Estimate], theirs: Sequence[Estimate]) -> bool:
    """Whether each of ``theirs`` is among ``ours`` with a smaller std, leaving out numbers that were chosen."""
    std = {one.name: one.std for one in ours}
    uncertain = [one for one in theirs if one.std > 0.0]
    return bool(uncertain) and all(0.0 < std.get(one.name, np.inf) < one.std for one in uncertain)


def extend(arm: Arm, causes: Sequence[Cause]) -> Arm:
    """The model with every cause as an additional effect."""
    terms = [term for cause in causes if cause.of_arm for term in cause.terms]
    return replace(fixed_gains(arm), effects=(*arm.effects, *terms))


def without_cause(extended: Arm, cause: Cause) -> Arm:
    """An extended model without the effects of a cause."""
    return replace(extended, effects=tuple(term for term in extended.effects if term not in cause.terms))
