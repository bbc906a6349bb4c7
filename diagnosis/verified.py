"""Causes with their errors in closed loop, and both models compared with the recordings."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import Cause
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import (
    Compared,
    along_motion,
    before_and_after,
    compare,
    with_smoothing_velocities,
)
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.residual.run import Run


@dataclass(frozen=True, kw_only=True)
class Verified:
    """The causes with their errors in closed loop, and both models compared with the recordings; see ``Diagnosis``.

    extended: the model of the second loop of each pair.
    """

    extended: Arm
    causes: list[Cause]
    compared: dict[str, list[tuple[Compared, Compared]]]
    along: dict[str, list[tuple[Array, Array]]]


def verify(
    arm: Arm,
    extended: Arm,
    causes: Sequence[Cause],
    recordings: Recordings,
    currents: CurrentDiagnosis,
    *,
    judged: bool,
) -> Verified:
    """The model and the extended one in closed loop on the recorded setpoints, and along the measured motion."""
    runs = currents.state.data.map(lambda part: part.runs)
    halves = {"fit": (recordings.fit, runs.fit), "held_out": (recordings.held_out, runs.held_out)}
    compared = _in_loop(arm, extended, halves)
    if extended is arm and clear_errors(compared, {half: seen for half, (_, seen) in halves.items()}, ()):
        # how friction turns round is on no data sheet; with causes, the extended model has it already
        smoothed = with_smoothing_velocities(arm, recordings.fit)
        if smoothed != arm:
            extended, compared = smoothed, _in_loop(arm, smoothed, halves)
    simulated = [after for _, after in compared["held_out"]]
    return Verified(
        extended=extended,
        causes=[_shown_in_loop(cause, extended, simulated, *halves["held_out"]) for cause in causes],
        compared=compared,
        along={
            half: [along_motion(run, arm, extended) for run in seen if judged] for half, (_, seen) in halves.items()
        },
    )


Halves = Mapping[str, tuple[Sequence[Recording], Sequence[Run]]]
"""By "fit" and "held_out": recordings, and their residuals."""


def _in_loop(arm: Arm, extended: Arm, halves: Halves) -> dict[str, list[tuple[Compared, Compared]]]:
    """By half, the recordings whose loops can be simulated: with the model, and with the extended one."""
    recordings = [recording for of_half, _ in halves.values() for recording in of_half]
    runs = [run for _, of_half in halves.values() for run in of_half]
    pairs = iter(before_and_after(recordings, runs, arm, extended))
    return {
        half: [pair for pair in itertools.islice(pairs, len(seen)) if pair is not None]
        for half, (_, seen) in halves.items()
    }


def _shown_in_loop(
    cause: Cause, extended: Arm, having: Sequence[Compared], recordings: Sequence[Recording], runs: Sequence[Run]
) -> Cause:
    """A cause that shows in closed loop only, with the errors of that loop.

    Such as a current limit: the measured motion obeys it, and along that motion nothing is missing.
    """
    joint = cause.felt_at
    if joint is None or cause.before != cause.after or len(having) != len(recordings):
        return cause
    others = tuple(term for term in extended.effects if term not in cause.terms)
    without = [compare(r, replace(extended, effects=others), run) for r, run in zip(recordings, runs)]
    before, after = (
        float(np.sqrt(np.mean([one.error_rms("current")[joint - 1] ** 2 for one in several if one])))
        for several in (without, having)
    )
    return replace(cause, before=before, after=after) if all(without) else cause
