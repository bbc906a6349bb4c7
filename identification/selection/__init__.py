"""Stepwise selection on held-out data: the engine, its statistics and its thresholds.

A leaf: it knows no effect and no arm.
"""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.selection.least_squares import scaled, scaled_lstsq
    from identification.selection.limits import Limits, Thresholds
    from identification.selection.robust_scale import MAD_TO_STD, MEDIAN_OF_NORM
    from identification.selection.significance import (
        BLOCK_SECONDS,
        Index,
        p_of_short_blocks,
        p_value,
        shift_p_value,
    )
    from identification.selection.split import Split
    from identification.selection.stepwise import MeasurementModel, Score, eliminate, select
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "BLOCK_SECONDS",
    "MAD_TO_STD",
    "MEDIAN_OF_NORM",
    "Index",
    "Limits",
    "MeasurementModel",
    "Score",
    "Split",
    "Thresholds",
    "eliminate",
    "p_of_short_blocks",
    "p_value",
    "scaled",
    "scaled_lstsq",
    "select",
    "shift_p_value",
]
