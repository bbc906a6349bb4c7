"""A cause with its values per recording, as a diagnosis says it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_model import EffectTerm
from arm_model.effects import Instrument
from diagnosis.cause import Cause, Estimate, confidence_of
from diagnosis.cause.units import fall
from diagnosis.measurements.currents.state import State
from diagnosis.per_recording.single_recordings import runs_of
from diagnosis.per_recording.values import ValuesPerRecording
from diagnosis.residual.comparable_rows import comparable_rows, rms_where
from diagnosis.residual.other_effects import with_own
from identification import recorded_quantity
from identification.selection import p_value


def cause_of(
    own: ValuesPerRecording, every: Sequence[ValuesPerRecording], state: State, others: Sequence[EffectTerm]
) -> Cause:
    """The cause with its values per recording; it is not in the extended model.

    Its parameters are the mean of the recordings, with their scatter as std, or with that of the recording that
    determines it best where they scatter less: a nonlinear parameter does not scatter, since one value serves all
    recordings. every: all that have such values; others: the causes of the arm.
    """
    c, held_out = own.candidate, len(state.data.fit.runs)
    runs, rms = runs_of(state)[held_out:], []
    for having in ([one for one in every if one is not own], every):
        extra = [[one.terms[held_out + k] for one in having] for k in range(len(runs))]
        several = [with_own(run, (*others, *more)) for run, more in zip(runs, extra)]
        left, rows = (np.concatenate(of) for of in zip(*((run.residual, comparable_rows(run)) for run in several)))
        rms.append(rms_where(left, rows))
    noise = np.mean([run.noise for run in runs], axis=0)
    joint = c.joint or int(np.argmax((rms[0] ** 2 - rms[1] ** 2) / noise**2)) + 1
    unit = state.model.arm.joints[joint - 1].command_unit
    before, after = (float(one[joint - 1]) for one in rms)
    mean = [_mean(several) for several in zip(*own.parameters)]
    aliases = (*c.definition.aliases, *c.definition.observed_by[Instrument.CURRENT].aliases)
    return Cause(
        effect=c.effect,
        joint=c.joint,
        parameters=mean,
        confidence=confidence_of(p_value(own.gains)),
        before=before,
        after=after,
        group=(c.key, *dict.fromkeys((name, c.joint) for name in aliases if name != c.effect)),
        evidence=f"{c.definition.shows}, differently in each recording: with one value per recording, the held-out "
        f"{recorded_quantity(state.model.arm.joints[joint - 1])} error of joint {joint} falls "
        f"{fall(before, after, unit)}; no single value fits all recordings",
        felt_at=joint,
        unit=unit,
        of_arm=False,
        of_recordings={run.name: values for run, values in zip(runs_of(state), own.parameters)},
    )


def _mean(several: Sequence[Estimate]) -> Estimate:
    """Mean of one parameter over recordings, with its std."""
    values, stds = np.array([(p.value, p.std) for p in several]).T
    std = max(float(np.std(values)), float(np.min(stds)))
    return Estimate(several[0].name, float(np.mean(values)), std, several[0].unit)
