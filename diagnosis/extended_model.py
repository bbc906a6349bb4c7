"""All causes of all instruments together, and the model that has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Cause, extend, merge
from diagnosis.closed_loop.comparison import with_smoothing_velocities
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.currents.causes import from_event
from diagnosis.other_instruments import OtherInstruments
from diagnosis.screening.event import Event
from diagnosis.verification.idle_limits import idle_limits


def extended_model(
    arm: Arm, instruments: OtherInstruments, currents: CurrentDiagnosis, recordings: Recordings
) -> tuple[list[Cause], Arm]:
    """All causes, each named once, and the model extended by them; without current limits that no current reaches."""
    events = [*currents.residuals.events, *instruments.events]
    causes, extended = _extended_with(events, arm, instruments, currents, recordings)
    idle = idle_limits(causes, extended, recordings, currents.state.data)
    if not idle:
        return causes, extended
    remaining = [event for event in events if (event.effect, event.joint) not in idle]
    return _extended_with(remaining, arm, instruments, currents, recordings)


def _extended_with(
    raw: Sequence[Event], arm: Arm, instruments: OtherInstruments, currents: CurrentDiagnosis, recordings: Recordings
) -> tuple[list[Cause], Arm]:
    """``extended_model`` with these events of raw rows and setpoints."""
    known = [*instruments.in_model, *currents.outside_selection]
    events = [from_event(event, currents.arm, currents.state.data) for event in raw]
    causes = [*events, *currents.causes, *currents.per_recording]
    # a spring that link encoders show as well is in the model with their parameters
    of_model = {cause.key for cause in known}
    unknown = [cause for cause in instruments.tracked.causes if cause.key not in of_model]
    together = merge(causes if instruments.judged else [*causes, *instruments.of_links], unknown)
    extended = extend(currents.base, together) if together else currents.arm
    if extended is not arm and not currents.per_recording:
        extended = with_smoothing_velocities(extended, recordings.fit)
    every = [*currents.outside_selection, *causes, *instruments.of_links]
    return merge(every, instruments.tracked.causes, of_model), extended


def top_speeds(currents: CurrentDiagnosis) -> Array:
    """(n,) rad/s (m/s): the highest speed of each joint in any of the recordings."""
    speeds = [np.abs(run.brisk_v).max(axis=0) for run in currents.state.all_runs]
    return np.asarray(np.max(speeds, axis=0))
