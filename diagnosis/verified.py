"""Causes with their errors in closed loop, and both models compared with the recordings."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import Cause, without_cause
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import (
    LoopComparison,
    LoopPair,
    along_motion,
    before_and_after,
    compare,
    with_smoothing_velocities,
)
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.residual.run import Run
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Verified:
    """The causes with their errors in closed loop, and both models compared with the recordings; see ``Diagnosis``.

    extended: the model of the second loop of each pair.
    """

    extended: Arm
    causes: list[Cause]
    closed_loops: Split[list[LoopPair]]
    along_motion: Split[list[tuple[Array, Array]]]


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
    runs = currents.state.runs
    loops = _closed_loops(arm, extended, recordings, runs)
    if extended is arm and clear_errors(loops, runs, ()):
        # how friction turns round is on no data sheet; with causes, the extended model has it already
        smoothed = with_smoothing_velocities(arm, recordings.fit)
        if smoothed != arm:
            extended, loops = smoothed, _closed_loops(arm, smoothed, recordings, runs)
    with_all = [after for _, after in loops.held_out]
    return Verified(
        extended=extended,
        causes=[_shown_in_loop(cause, extended, with_all, recordings.held_out, runs.held_out) for cause in causes],
        closed_loops=loops,
        along_motion=runs.map(lambda part: [along_motion(run, arm, extended) for run in part if judged]),
    )


def _closed_loops(
    arm: Arm, extended: Arm, recordings: Recordings, runs: Split[tuple[Run, ...]]
) -> Split[list[LoopPair]]:
    """Recordings whose loops can be simulated, with the model and with the extended one."""
    every = [recording for part in recordings for recording in part]
    pairs = iter(before_and_after(every, [run for part in runs for run in part], arm, extended))
    return runs.map(lambda part: [pair for pair in itertools.islice(pairs, len(part)) if pair is not None])


def _shown_in_loop(
    cause: Cause,
    extended: Arm,
    loops: Sequence[LoopComparison],
    recordings: Sequence[Recording],
    runs: Sequence[Run],
) -> Cause:
    """A cause that shows in closed loop only, with the errors of that loop.

    Such as a current limit: the measured motion obeys it, and along that motion nothing is missing. loops: those of the
    ``extended`` model, of held-out ``recordings``.
    """
    joint = cause.felt_at
    if joint is None or cause.before != cause.after or len(loops) != len(recordings):
        return cause
    fewer = without_cause(extended, cause)
    loops_without = [compare(r, fewer, run) for r, run in zip(recordings, runs)]
    before, after = (
        float(np.sqrt(np.mean([one.error_rms("current")[joint - 1] ** 2 for one in several if one])))
        for several in (loops_without, loops)
    )
    return replace(cause, before=before, after=after) if all(loops_without) else cause
