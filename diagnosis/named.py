"""What the currents of recordings show: causes, and what they were found in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import Cause, Structure
from diagnosis.measurements.currents.design_matrix import Library
from diagnosis.measurements.currents.search import Found
from diagnosis.measurements.currents.shortage import Shortage
from diagnosis.measurements.single_axis.causes import AxisSide
from diagnosis.screening.residuals import Residuals
from diagnosis.selection.candidate import Candidate
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Named:
    """What the currents of recordings name, conditional on what is known of the arm.

    arm         the model with all that is known of it; residuals: of the recordings under it
    base        the arm that the causes extend
    library     every candidate's columns; ripples: candidates that have columns only where they stand out of the
                residual
    found       what the search chose; axis: what a single axis with a fine encoder shows
    causes      of the search or of the axis
    near_rest   friction found where joints turn or creep; transmissions: a spring or a gap found in closed loop, or the
                gaps of the search. ``arm`` has both
    undetermined  joints that show friction near rest whose size the recordings do not determine
    shortage    what the held-out recordings are too short for
    own         causes whose values differ between recordings; the runs have them, ``base`` has not
    """

    arm: Arm
    residuals: Residuals
    base: Arm
    library: Library
    ripples: tuple[Candidate, ...]
    found: Found
    axis: AxisSide | None
    causes: list[Cause]
    shortage: Shortage | None = None
    near_rest: tuple[Cause, ...] = ()
    transmissions: tuple[Cause, ...] = ()
    undetermined: tuple[Structure, ...] = ()
    own: tuple[Cause, ...] = ()

    @property
    def beside(self) -> list[Cause]:
        """Causes that were found beside the search, and that ``arm`` has."""
        return [*self.near_rest, *self.transmissions]


Recordings = Split[Sequence[Recording]]
