"""Another recording held out, where the held-out ones show nothing of a joint that the fitted ones leave unexplained.

A cause needs a recording that it was not fitted to. Of a joint that hardly moves in the held-out ones, one of the
fitted ones can be it, if at least two of them show the joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq.recording import Recording
from diagnosis.cause import Signal
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.result import Diagnosis
from identification.selection import Split

Roles = Split[list[Recording]]


def other_roles(found: Diagnosis, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Roles | None:
    """The recordings with a fitted one held out in the place of the others; None where that decides nothing.

    It is the one that shows the joint second best, so that the best one is fitted.
    """
    every, names = [*fit, *held_out], [r.path.name for r in (*fit, *held_out)]
    if len(set(names)) < len(names) or {run.name for run in found.fit} != set(names[: len(fit)]):
        return None
    if (joint := _joint_in_fit_alone(found)) is None:
        return None
    residual = found.residual.fit.reshape(len(found.arm), -1)[joint - 1]
    by_recording = np.split(residual, np.cumsum([len(run.t) for run in found.fit]))
    squares = {run.name: float(np.mean(own**2)) for run, own in zip(found.fit, by_recording)}
    above_noise = [name for name, square in squares.items() if square > LIMITS.above_noise**2]
    if len(above_noise) < 2:
        return None
    _, second, *_ = sorted(above_noise, key=lambda name: -squares[name])
    return Split([r for r in every if r.path.name != second], [r for r in every if r.path.name == second])


def _joint_in_fit_alone(found: Diagnosis) -> int | None:
    """The joint whose current is all that is unexplained, in fitted recordings alone; None otherwise."""
    if len(found.unexplained) != 1:
        return None
    (one,) = found.unexplained
    return one.joint if one.signal is Signal.CURRENT and one.fit_only else None


def better(found: Diagnosis, other: Diagnosis) -> Diagnosis:
    """The ``other`` diagnosis, with a remark, if it has the causes that were ``found``, and explains the rest."""
    members = [set(cause.group) | {cause.key} for cause in other.causes]
    kept = all(any(cause.key in group for group in members) for cause in found.causes)
    if other.unexplained or not kept:
        return found
    joint, (name,) = found.unexplained[0].joint, [run.name for run in other.held_out]
    remark = f"the held-out recordings show too little of joint {joint}: {name} was held out in their place"
    return replace(other, warnings=(*other.warnings, remark), exchanged=True)
