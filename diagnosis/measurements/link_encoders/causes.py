"""Causes from the two encoders of a joint: parameters, ambiguity groups, evidence, and the remaining residual.

The measurement model is ``model.LinkEncoders``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Instrument
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, Estimate, Signal, Structure, confidence_of
from diagnosis.measurements.link_encoders.candidates import LinkCandidate, orders
from diagnosis.measurements.link_encoders.delay import delay_sentence
from diagnosis.measurements.link_encoders.estimates import lag_of, parameters_of
from diagnosis.measurements.link_encoders.model import LIMITS, Chosen, LinkEncoders, link_encoders
from diagnosis.measurements.link_encoders.per_recording import contradicted
from diagnosis.measurements.link_encoders.rows import Rows
from diagnosis.measurements.link_encoders.unexplained import remarks, unexplained_by_link_encoders
from diagnosis.measurements.link_encoders.zero_offsets import zero_offsets
from diagnosis.selection.beyond_model import in_deviations
from identification.selection import Split, select


@dataclass(frozen=True, kw_only=True)
class LinkSide:
    """Causes and unexplained structure of the link-encoder differences.

    held_out: the held-out rows; without, residual (m, k): their difference less its constant, and after all causes;
    remarks: residuals above the scatter of the encoders, per joint.
    """

    causes: list[Cause]
    unexplained: list[Structure]
    held_out: Rows
    without: Array
    residual: Array
    remarks: tuple[str, ...]


def link_side(arm: Arm, recordings: Split[Sequence[Recording]]) -> LinkSide | None:
    """Diagnoses the difference of motor and link encoders; None where no joint of all recordings has both."""
    model = link_encoders(arm, recordings)
    if model is None:
        return None
    model, chosen = _agreeing(model)
    causes = [_cause(candidate, chosen, model, arm) for candidate in chosen] + zero_offsets(chosen, model, arm)
    return LinkSide(
        causes=causes,
        unexplained=unexplained_by_link_encoders(chosen, model),
        held_out=model.rows.held_out,
        without=model.residual((), *model.rows),
        residual=model.residual(chosen, *model.rows),
        remarks=tuple(remarks(chosen, model, arm)),
    )


def _agreeing(model: LinkEncoders) -> tuple[LinkEncoders, Chosen]:
    """Causes whose values agree between recordings; one whose values disagree is excluded and the search repeated."""
    while True:
        selected: Chosen = select(model)
        chosen = tuple(_refined(candidate, selected, model) for candidate in selected)
        refused = contradicted(chosen, model)
        if refused is None:
            return model, chosen
        model = replace(model, excluded=model.excluded | {refused.key})


def _refined(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders) -> LinkCandidate:
    """A chosen candidate with its gap refined from the nearest grid value by its own coefficient, a spring damped."""
    if candidate.definition.spring is not None and candidate.definition.gap is None:
        return candidate.at("lag", lag_of(candidate, chosen, model)[0])
    if candidate.variant[0] != "half_gap":
        return candidate
    for _ in range(4):
        candidate = candidate.at("half_gap", float(model.fitted([candidate], model.whole)[-1]))
    return candidate


def _cause(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, arm: Arm) -> Cause:
    """A chosen candidate as a cause, conditional on all others, at the joint where it shows most."""
    others = model.without(candidate, chosen)
    conditional = model.score(candidate, others)
    affected = model.affected(candidate)
    counted = model.counted(chosen, model.rows.held_out)
    residuals = [
        model.residual(some, model.rows.fit, model.rows.held_out, counted)[:, affected] for some in (others, chosen)
    ]
    before, after = (float(np.sqrt(np.mean(values**2))) for values in residuals)
    strongest = affected[int(np.argmax(np.sum(residuals[0] ** 2 - residuals[1] ** 2, axis=0)))]
    unit = arm.joints[int(model.rows.fit.joints[affected[0]]) - 1].unit("rad")
    evidence = (
        delay_sentence(others, model)
        if candidate.definition.delay is not None
        else _sentence(
            candidate, [int(model.rows.fit.joints[k]) for k in affected], before, after, conditional.share, unit
        )
    )
    parameters = parameters_of(candidate, chosen, model, arm)
    group = _group(candidate, others, conditional.gain, model, parameters)
    evidence += "".join(
        f"; these recordings do not determine its {p.name}: it is at most {2 * p.std:.2g} {p.unit}"
        for p in parameters
        if p.std >= abs(p.value) and not candidate.definition[p.name].whole
    )
    return Cause(
        effect=candidate.effect,
        joint=candidate.joint,
        parameters=parameters,
        confidence=confidence_of(conditional.p),
        before=before,
        after=after,
        group=group,
        evidence=evidence,
        felt_at=int(model.rows.fit.joints[strongest]),
        unit=unit,
        signal=Signal.LINK_ANGLE,
        of_arm=candidate.definition.observed_by[Instrument.LINK_ENCODER].of_arm,
        deviations=_deviations(candidate, others, model),
    )


def _deviations(candidate: LinkCandidate, others: Chosen, model: LinkEncoders) -> tuple[float, float] | None:
    """Significance of a cause with exact masses and with their stated uncertainty; None if the model states none."""
    if not model.knows_errors:
        return None
    return in_deviations(model.chance(candidate, others, exact=True)), in_deviations(model.chance(candidate, others))


def _group(
    candidate: LinkCandidate, others: Chosen, gain: float, model: LinkEncoders, parameters: Sequence[Estimate]
) -> tuple[EffectKey, ...]:
    """The effects that these recordings do not distinguish from a candidate with this gain, itself included.

    An order of a ripple that is within two std of a whole number may be that number.
    """
    group: list[EffectKey] = [candidate.key]
    for alias in candidate.definition.observed_by[Instrument.LINK_ENCODER].aliases:
        near = [p for p in parameters if candidate.definition[p.name].whole]
        if any(abs(p.value - n) <= 2 * p.std for p in near for n in orders(CATALOGUE[alias])):
            group.append((alias, candidate.joint))
    for rival in model.best(others):
        affected = rival.joint == candidate.joint or len(model.rows.fit.joints) == 1
        if rival.effect == candidate.effect or not affected or not model.is_physical(rival, others):
            continue
        alone, share = model.score(rival, others).gain, LIMITS.ambiguity
        if alone >= share * gain and model.score(rival, [*others, candidate]).gain < (1.0 - share) * alone:
            group.append(rival.key)
    return tuple(group)


def _sentence(
    candidate: LinkCandidate, joints: Sequence[int], before: float, after: float, share: float, unit: str
) -> str:
    """Evidence of a cause that shows at these joints; the share of both folds may exceed that of the fall."""
    order = {p.name: candidate.variant[1] for p in candidate.definition.parameters if p.whole}
    shows = candidate.definition.shown(Instrument.LINK_ENCODER, order, {})
    return (
        f"{shows}: with it, the held-out difference of joint{'s' * (len(joints) > 1)} {' and '.join(map(str, joints))} "
        f"falls from {1e3 * before:.3g} to {1e3 * after:.3g} m{unit} rms; it explains {share:.0%} of its square"
    )
