"""Results of a calibration as files and a page."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.report.html import error_figure, page
    from identification.kinematics.report.write import calibrated_model, summary, table_of, write_json
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "calibrated_model",
    "error_figure",
    "page",
    "summary",
    "table_of",
    "write_json",
]
