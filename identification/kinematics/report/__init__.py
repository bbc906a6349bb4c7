"""Results of a calibration as files and a page."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.report.html import page
    from identification.kinematics.report.plots import error_chart
    from identification.kinematics.report.points import point_rows, write_points
    from identification.kinematics.report.write import calibrated_model, summary, table_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "calibrated_model",
    "error_chart",
    "page",
    "point_rows",
    "summary",
    "table_of",
    "write_points",
]
