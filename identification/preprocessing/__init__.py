"""Recordings made ready: filtered signals, spectra, quality flags, input checks."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.preprocessing.aliased_lines import (
        folding_line,
        line_onto_zero,
        lines_beside_zero,
        period_of,
        whole_rows,
    )
    from identification.preprocessing.aliased_ripple import UNSEEN, drifting, folded_along, rate_beside, rows_a_setpoint
    from identification.preprocessing.demands import demand_of_run, tracked_as_recorded
    from identification.preprocessing.filtering import zero_phase
    from identification.preprocessing.readiness import Readiness
    from identification.preprocessing.setpoint_lines import seen_rows
    from identification.preprocessing.setpoints import setpoint_period
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "UNSEEN",
    "Readiness",
    "demand_of_run",
    "drifting",
    "folded_along",
    "folding_line",
    "line_onto_zero",
    "lines_beside_zero",
    "period_of",
    "rate_beside",
    "rows_a_setpoint",
    "seen_rows",
    "setpoint_period",
    "tracked_as_recorded",
    "whole_rows",
    "zero_phase",
]
