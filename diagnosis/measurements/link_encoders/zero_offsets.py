"""Constants between the two encoders of a joint: which of the two is wrong, they do not show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects.description_errors import JOINT_ZERO_OFFSET
from diagnosis.cause import Cause, Estimate, Signal
from diagnosis.cause.evidence import MAX_CONFIDENCE
from diagnosis.measurements.link_encoders.estimates import coefficients
from diagnosis.measurements.link_encoders.model import LIMITS, Chosen, LinkEncoders
from diagnosis.measurements.link_encoders.per_recording import single_estimates
from diagnosis.selection.contradiction import CHANCE, chance_of


def zero_offsets(chosen: Chosen, model: LinkEncoders, arm: Arm) -> list[Cause]:
    """Constants between two encoders that are large and significant; each recording's own, where they differ."""
    recordings, causes = single_estimates(chosen, model), []
    values, covariance = coefficients(chosen, model)
    for k, joint in enumerate(int(j) for j in model.rows.fit.joints):
        unit = arm.joints[joint - 1].unit("rad")
        each = {recording.name: _offset(recording.values, recording.covariance, k, unit) for recording in recordings}
        together = _offset(values, covariance, k, unit)
        differ = chance_of(recordings, slice(k, k + 1)) < CHANCE / len(model.rows.fit.joints)
        largest = max(each.values(), key=lambda one: abs(one.value)) if differ else together
        if abs(largest.value) < max(LIMITS.offset, LIMITS.offset_stds * largest.std):
            continue
        residual = model.residual(chosen, *model.rows)[:, k]
        held_out = np.array([each[name].value for name in dict.fromkeys(model.rows.held_out.names)])
        left = np.zeros(1) if differ else held_out - together.value
        before, after = (float(np.sqrt(np.mean(c**2) + np.mean(residual**2))) for c in (held_out, left))
        causes.append(
            Cause(
                effect=JOINT_ZERO_OFFSET.name,
                joint=joint,
                parameters=[largest],
                confidence=MAX_CONFIDENCE,
                before=before,
                after=after,
                group=((JOINT_ZERO_OFFSET.name, joint),),
                evidence=_zero_sentence(joint, each if differ else {"": together}),
                felt_at=joint,
                unit=unit,
                signal=Signal.LINK_ANGLE,
                of_arm=False,
                of_recordings={name: [one] for name, one in each.items()} if differ else {},
            )
        )
    return causes


def _offset(values: Array, covariance: Array, k: int, unit: str) -> Estimate:
    """The constant of the k-th joint, of coefficients (c,) that begin with the constants of all joints."""
    return Estimate("offset", float(values[k]), float(np.sqrt(covariance[k, k])), unit)


def _zero_sentence(joint: int, each: Mapping[str, Estimate]) -> str:
    """A sentence on the excess of the motor encoder over the link encoder, per recording or for all of them ("")."""
    readings = [
        f"{abs(1e3 * one.value):.3g} m{one.unit} {'more' if one.value > 0 else 'less'}{f' in {name}' if name else ''}"
        for name, one in each.items()
    ]
    if len(readings) > 1:
        return (
            f"the motor encoder of joint {joint} reads {', '.join(readings)} than the link encoder: one of them gets "
            "a new zero at every start, so that the value differs between recordings; each held-out recording is "
            "judged relative to its own value"
        )
    return (
        f"the motor encoder of joint {joint} reads {readings[0]} than the link encoder at all positions; a level or a "
        "tracker shows which of the two is wrong, so the model is not changed"
    )
