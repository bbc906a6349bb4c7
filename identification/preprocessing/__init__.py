"""Recordings made ready: filtered signals, spectra, quality flags, input checks."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.preprocessing.demands import demand_of_run, tracked_as_recorded
    from identification.preprocessing.filtering import butterworth, zero_phase
    from identification.preprocessing.mechanism import check_joints
    from identification.preprocessing.readiness import Readiness
    from identification.preprocessing.setpoint_ripple import Driven, drifting, folded_along, lines_beside_zero
    from identification.preprocessing.setpoints import UNKNOWN, Setpoints, setpoints_of, stated_period
    from identification.preprocessing.spectrum import choose_band
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "UNKNOWN",
    "Driven",
    "Readiness",
    "Setpoints",
    "butterworth",
    "check_joints",
    "choose_band",
    "demand_of_run",
    "drifting",
    "folded_along",
    "lines_beside_zero",
    "setpoints_of",
    "stated_period",
    "tracked_as_recorded",
    "zero_phase",
]
