"""What instruments other than the current transducers show: tracker, link encoders, setpoints."""

from __future__ import annotations

from dataclasses import dataclass

from arm_io.types import Progress
from arm_model import Arm
from diagnosis.cause import Cause
from diagnosis.current_diagnosis import Recordings
from diagnosis.measurements.demands.wrist_coupling import wrist_coupling
from diagnosis.measurements.link_encoders.causes import LinkSide, link_side
from diagnosis.measurements.tracker.causes import Tracked, tracked_causes
from diagnosis.residual.expected_current import has_dynamics
from diagnosis.screening.cleaned import Screened
from diagnosis.screening.event import Event


@dataclass(frozen=True, kw_only=True)
class OtherInstruments:
    """What instruments other than the current transducers show.

    events  in setpoints
    judged  whether the model predicts any current with which the measured ones can be compared
    """

    tracked: Tracked
    link: LinkSide | None
    events: list[Event]
    judged: bool

    @property
    def known(self) -> list[Cause]:
        """Causes that are in the model before the currents are judged: of geometry and of transmissions."""
        return [*self.tracked.geometry, *(cause for cause in self.of_links if cause.of_arm and self.judged)]

    @property
    def of_links(self) -> list[Cause]:
        """Causes that the link encoders show."""
        return self.link.causes if self.link else []


def measure(arm: Arm, recordings: Recordings, cleaned: Screened, progress: Progress) -> OtherInstruments:
    """What tracker, link encoders and setpoints show."""
    angles = [q for _, q, _ in cleaned.samples]
    tracked = tracked_causes(arm, *recordings, angles=angles, progress=progress)
    progress("comparing motor and link encoders")
    return OtherInstruments(
        tracked=tracked,
        link=link_side(arm, *recordings),
        events=wrist_coupling(*recordings),
        judged=has_dynamics(arm),
    )
