"""Stepwise selection on held-out data: the engine, its statistics and its thresholds. A leaf: it knows no effect and no arm."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.selection.cluster_covariance import cluster_covariance
    from identification.selection.limits import Limits
    from identification.selection.split import Split
    from identification.selection.stepwise import MeasurementModel, Score, eliminate, select
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Limits",
    "MeasurementModel",
    "Score",
    "Split",
    "cluster_covariance",
    "eliminate",
    "select",
]
