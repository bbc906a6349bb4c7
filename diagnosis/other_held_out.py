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
from diagnosis.remainder.fitted_only import IN_FIT
from diagnosis.result import Diagnosis
from identification.selection import Split

Roles = Split[list[Recording]]


def other_roles(found: Diagnosis, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Roles | None:
    """The recordings with a fitted one held out in the place of the others; None where that decides nothing.

    It is the one that shows the joint second best, so that the best one is fitted.
    """
    names = [r.path.name for r in (*fit, *held_out)]
    if len(set(names)) < len(names) or {run.name for run in found.fit} != set(names[: len(fit)]):
        return None
    if not _fit_alone(found):
        return None
    joint = found.unexplained[0].joint or 1
    left = np.split(found.residual.fit.reshape(len(found.arm), -1)[joint - 1], np.cumsum([len(r.t) for r in found.fit]))
    shown = {run.name: float(np.mean(own**2)) for run, own in zip(found.fit, left)}
    loud = sorted((name for name in shown if shown[name] > LIMITS.above_noise**2), key=lambda name: -shown[name])
    if len(loud) < 2:
        return None
    every = [*fit, *held_out]
    return Split([r for r in every if r.path.name != loud[1]], [r for r in every if r.path.name == loud[1]])


def _fit_alone(found: Diagnosis) -> bool:
    """Whether all that is unexplained is the current of one joint, in fitted recordings alone."""
    joints = {one.joint for one in found.unexplained if one.signal is Signal.CURRENT and one.size.endswith(IN_FIT)}
    return len(joints) == 1 and len(found.unexplained) == 1


def better(found: Diagnosis, other: Diagnosis) -> Diagnosis:
    """The ``other`` diagnosis, with a remark, if it has the causes that were ``found``, and explains the rest."""
    members = [set(cause.group) | {cause.key} for cause in other.causes]
    kept = all(any(cause.key in group for group in members) for cause in found.causes)
    if other.unexplained or not kept:
        return found
    joint, (name,) = found.unexplained[0].joint, [run.name for run in other.held_out]
    remark = f"the held-out recordings show too little of joint {joint}: {name} was held out in their place"
    return replace(other, warnings=(*other.warnings, remark), exchanged=True)
