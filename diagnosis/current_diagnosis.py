"""What the currents of recordings show: causes, and the selection and residuals behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import Cause, Structure
from diagnosis.measurements.currents.design_matrix import Library
from diagnosis.measurements.currents.search import Selection
from diagnosis.measurements.currents.shortage import Shortage
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.single_axis.causes import AxisSide
from diagnosis.screening.residuals import Residuals
from diagnosis.selection.candidate import Candidate
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class CurrentDiagnosis:
    """The result of the search in the currents of recordings, conditional on causes that are already known.

    arm           the model with all that is known of it; residuals: of the recordings under it
    base          the arm that the causes extend
    library       every candidate's columns; ripples: candidates that have columns only where they exceed the residual
    selection     what stepwise selection chose; axis: what a single axis with a fine encoder shows
    causes        of the selection or of the axis
    near_rest     friction found at standstill and reversals; transmissions: a spring or a gap found in closed loop, or
                  the gaps of the selection. ``arm`` has both
    undetermined  joints that show friction near rest whose size the recordings do not determine
    shortage      what the held-out recordings are too short for
    held          delays of the currents that are how rows show what servos hold: part of the selection, and no causes
                  (``diagnosis.verification.held_currents``)
    per_recording causes whose values differ between recordings; the runs have them, ``base`` has not
    """

    arm: Arm
    residuals: Residuals
    base: Arm
    library: Library
    ripples: tuple[Candidate, ...]
    selection: Selection
    axis: AxisSide | None
    causes: list[Cause]
    shortage: Shortage | None = None
    near_rest: tuple[Cause, ...] = ()
    transmissions: tuple[Cause, ...] = ()
    undetermined: tuple[Structure, ...] = ()
    held: tuple[Cause, ...] = ()
    per_recording: tuple[Cause, ...] = ()

    @property
    def state(self) -> State:
        """The chosen candidates, fitted together."""
        return self.selection.state

    @property
    def by_selection(self) -> bool:
        """Whether the stepwise selection judged the recordings: not a single axis, nor a model without dynamics."""
        return self.axis is None and bool(self.library)

    @property
    def by_exact_model(self) -> bool:
        """Whether the selection judged the recordings, and its model counts as exact: it states no uncertainty.

        With such a model alone, chattering teeth, the rise of a break-away level, and friction near rest and lost rows
        in simulated loops are judged: errors of any other model move these instants and loops as well.
        """
        return self.by_selection and self.arm.uncertainty is None

    @property
    def outside_selection(self) -> list[Cause]:
        """Causes that were found outside the stepwise selection; ``arm`` includes them."""
        return [*self.near_rest, *self.transmissions]


Recordings = Split[Sequence[Recording]]
