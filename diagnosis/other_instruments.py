"""What instruments other than the current transducers show: tracker, link encoders, setpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from arm_io.types import Array, Progress
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Instrument, coupled
from diagnosis.cause import Cause, extend
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
    def in_model(self) -> list[Cause]:
        """Causes that are in the model before the currents are judged: of geometry and of transmissions."""
        return [*self.tracked.geometry, *(cause for cause in self.of_links if cause.of_arm and self.judged)]

    @property
    def of_links(self) -> list[Cause]:
        """Causes that the link encoders show."""
        return self.link.causes if self.link else []


def measure(arm: Arm, recordings: Recordings, cleaned: Screened, progress: Progress) -> OtherInstruments:
    """What tracker, link encoders and setpoints show."""
    progress("comparing motor and link encoders")
    angles = [q for _, q, _ in cleaned.samples]
    # counts that a motor's encoder missed are no difference between motor and link
    without_jumps = [replace(r, q=q) for r, q in zip((*recordings.fit, *recordings.held_out), angles)]
    link = link_side(arm, recordings.cut(without_jumps))
    of_links = link.causes if link else []
    by_links = [cause for cause in of_links if CATALOGUE[cause.effect].coupling]
    by_demands = [] if by_links else wrist_coupling(*recordings)
    seen = _as_turned(
        extend(arm, [cause for cause in of_links if _hidden_from_tracker(cause)]), [*by_links, *by_demands]
    )
    tracked = tracked_causes(seen, *recordings, angles=angles, progress=progress)
    return OtherInstruments(tracked=tracked, link=link, events=by_demands, judged=has_dynamics(arm))


def tracked_beside(
    of_currents: Sequence[Cause],
    arm: Arm,
    instruments: OtherInstruments,
    recordings: Recordings,
    angles: Sequence[Array],
    progress: Progress,
) -> OtherInstruments:
    """The same, with the tracker's links where springs, gaps and gears that currents or link encoders show let them be.

    If nothing is unexplained then, and nothing else is named: the currents' model has the geometry. angles: (rows, n)
    rad of every recording as of ``measure``.
    """
    tracked = instruments.tracked
    known = {cause.key for cause in tracked.causes}
    shown = {one.key: one for one in (*of_currents, *instruments.of_links)}
    behind = [one for one in shown.values() if CATALOGUE[one.effect].deflection is not None and one.key not in known]
    if not (tracked.unexplained and behind):
        return instruments
    by_links = [cause for cause in instruments.of_links if CATALOGUE[cause.effect].coupling]
    seen = _as_turned(extend(arm, behind), [*by_links, *instruments.events])
    again = tracked_causes(seen, *recordings, angles=angles, progress=progress)
    of_links, as_before = ({cause.key for cause in one.geometry} for one in (again, tracked))
    same = of_links == as_before and known.issuperset(cause.key for cause in again.causes)
    return replace(instruments, tracked=again) if same and not again.unexplained else instruments


def _hidden_from_tracker(cause: Cause) -> bool:
    """Whether a cause of the link encoders moves the links that a tracker sees, which has no name for any like it.

    A wave of a gear of any order: what its points show of that would be taken for another geometry.
    """
    moves = CATALOGUE[cause.effect].deflection is not None
    return moves and not any(Instrument.TRACKER in CATALOGUE[name].observed_by for name, _ in cause.group)


def _as_turned(arm: Arm, by: Sequence[Cause | Event]) -> Arm:
    """The arm whose links are where motors turn them by these couplings, as the tracker sees them."""
    turned = tuple(EffectTerm(one.effect, one.joint, {p.name: p.value for p in one.parameters}) for one in by)
    return replace(coupled(replace(arm, effects=turned)), effects=arm.effects)
