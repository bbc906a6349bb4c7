"""Result of a diagnosis: everything that the report and diagnosis.json say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Instrument
from daq.recording import Recording
from diagnosis.cause import Cause, Structure, Undetectable
from diagnosis.closed_loop.comparison import LoopPair, faithful
from diagnosis.measurements.currents.shortage import Shortage
from diagnosis.measurements.link_encoders.causes import LinkSide
from diagnosis.measurements.single_axis.causes import AxisSide
from diagnosis.measurements.tracker.causes import Tracked
from diagnosis.origins import Suspect, evidence_of, suspects
from diagnosis.remainder.of_identification import AllowedResidual
from diagnosis.residual.run import Run
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Everything that the report and diagnosis.json say.

    arm, extended  the model, and the model with every cause as an effect
    fit, held_out  the recordings with their residual currents; residual: (N,) whitened, with all causes in the model
    closed_loops   each recording's closed loop by the model and by the extended one
    along_motion   (n,) A rms of each recording's residual under both along the measured motion
    judged         whether the currents were compared: not with a model that predicts none
    shortage       what the held-out recordings are too short for
    known_to       (n,) times the noise that held-out residuals may be by what the model says of its own uncertainty;
                   known_to_fitted: that fitted ones may be
    exchanged      whether recordings were held out others than those that were given as such (``other_held_out``)
    allowed_residuals     what is above the noise within that, joint by joint
    """

    arm: Arm
    extended: Arm
    fit: tuple[Run, ...]
    held_out: tuple[Run, ...]
    residual: Split[Array]
    causes: list[Cause]
    undetectable: list[Undetectable]
    unexplained: list[Structure]
    closed_loops: Split[list[LoopPair]] = field(repr=False)
    along_motion: Split[list[tuple[Array, Array]]]
    encoder_noise: Array
    link: LinkSide | None = None
    tracked: Tracked | None = None
    axis: AxisSide | None = None
    judged: bool = True
    shortage: Shortage | None = None
    known_to: Array | None = None
    known_to_fitted: Array | None = None
    allowed_residuals: list[AllowedResidual] = field(default_factory=list)
    warnings: tuple[str, ...] = ()
    exchanged: bool = False

    @property
    def in_closed_loop(self) -> bool:
        """Whether current errors are those of the closed loop on the same demands; else along the measured motion."""
        return faithful(self.closed_loops.held_out, self.along_motion.held_out)

    @property
    def verdict(self) -> str:
        """``consistent``, ``explained`` or ``unexplained``; with a ``shortage``, of what could be judged."""
        if self.unexplained:
            return "unexplained"
        return "explained" if self.causes else "consistent"

    def roles(self, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Split[list[Recording]]:
        """Recordings that were given as fitted and held out, as they were in the end."""
        if not self.exchanged:
            return Split(list(fit), list(held_out))
        every, names = [*fit, *held_out], {run.name for run in self.held_out}
        return Split([r for r in every if r.path.name not in names], [r for r in every if r.path.name in names])

    @property
    def origins(self) -> list[Suspect]:
        """Physical origins of the causes, per joint and of the arm; none where unexplained structure remains."""
        places = evidence_of(
            self.causes, self.arm, self._searched, {(one.effect, one.joint) for one in self.undetectable}
        )
        unexplained = {structure.joint for structure in self.unexplained}
        return suspects([place for place in places if place.joint not in unexplained])

    @property
    def _searched(self) -> set[Instrument]:
        """Instruments whose effects would have been found."""
        instruments = {Instrument.RAW}
        if self.judged:
            instruments |= {Instrument.SINGLE_AXIS} if self.axis else {Instrument.CURRENT, Instrument.LAG}
        if self.link:
            instruments.add(Instrument.LINK_ENCODER)
        if self.tracked and self.tracked.rms:
            instruments.add(Instrument.TRACKER)
        return instruments
