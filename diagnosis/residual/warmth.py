"""By how much motors are warmer than where the model's friction holds, and whether recordings show what that does.

A model may state the temperature at which the friction of a joint holds. Where it does not, a dependence is judged
about the mean of the fitted recordings; a friction that is another there is a change of its level.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Excitation
from arm_model.tables import recorded_temperatures
from daq.recording import Recording
from diagnosis.cause import EffectKey
from diagnosis.residual.run import Run

LEAST = 3.0
"""K between the coldest and the warmest of the fitted rows, at least, as for ``identify``."""


def warmth(run: Run, joint: int) -> Array | None:
    """(m,) K: temperature of a joint's (from 1) motor above the one at which its friction holds; None if unknown."""
    reference, temperatures = run.arm.joints[joint - 1].temperature, run.arm.temperatures
    degc = None if temperatures is None else temperatures.at(joint - 1, run.t)
    return None if degc is None or reference is None else degc - reference


def with_reference(arm: Arm, recordings: Sequence[Recording]) -> Arm:
    """The arm with a temperature for the friction of each joint that has a sensor: the model's, or the mean, degC."""
    known = [recorded_temperatures(recording.t, recording.temp) for recording in recordings]
    joints = []
    for j, joint in enumerate(arm.joints):
        degc = [
            temperatures.at(j, recording.t)
            for recording, temperatures in zip(recordings, known)
            if temperatures is not None
        ]
        seen = [one for one in degc if one is not None]
        if joint.temperature is None and seen:
            joint = replace(joint, temperature=round(float(np.mean(np.concatenate(seen))), 1))
        joints.append(joint)
    return replace(arm, joints=tuple(joints))


def with_needed_reference(extended: Arm, model: Arm) -> Arm:
    """The extended model without the temperatures of joints whose friction does not depend on it, and had none."""
    warm = {term.joint for term in extended.effects if depends(term.name)}
    joints = (
        one if j in warm else replace(one, temperature=before.temperature)
        for j, (one, before) in enumerate(zip(extended.joints, model.joints), 1)
    )
    return replace(extended, joints=tuple(joints))


def reference_taken(model: Arm, named: Iterable[EffectKey], runs: Sequence[Run]) -> Iterator[str]:
    """A sentence per joint at which friction over temperature is ``named`` and the model states no temperature."""
    for effect, joint in named:
        if joint is not None and depends(effect) and model.joints[joint - 1].temperature is None:
            degc = runs[0].arm.joints[joint - 1].temperature
            yield (
                f"the model does not state the temperature of its friction at joint {joint}: the dependence is "
                f"relative to {degc:g} degC, the mean of the fitted recordings"
            )


def not_warmed(fit: Sequence[Run], held_out: Sequence[Run], joint: int) -> str:
    """Why recordings cannot show a dependence of friction at a joint (from 1) on temperature; "" if they can."""
    seen = [warmth(run, joint) for run in (*fit, *held_out)]
    if any(one is None for one in seen):
        return f"not every recording has the temperature of motor {joint}"
    span = float(np.ptp(np.concatenate([one for one in seen[: len(fit)] if one is not None])))
    if span < LEAST:
        return (
            f"the temperature of motor {joint} spans {span:.1f} K only, and less than {LEAST:g} K shows no dependence"
        )
    return ""


def depends(effect: str) -> bool:
    """Whether an effect is friction that depends on temperature."""
    return CATALOGUE[effect].excited_by is Excitation.TEMPERATURE
