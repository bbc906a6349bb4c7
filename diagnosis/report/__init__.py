"""Results of a diagnosis as files, words, tables and pages."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from diagnosis.report.data_frame import causes_frame
    from diagnosis.report.floating_base import base_report, write_base_diagnosis
    from diagnosis.report.html import report
    from diagnosis.report.plots.overview import overview
    from diagnosis.report.text import diagnosis_text
    from diagnosis.report.wording import title
    from diagnosis.report.write import Experiments, table_of, write_diagnosis
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Experiments",
    "base_report",
    "causes_frame",
    "diagnosis_text",
    "overview",
    "report",
    "table_of",
    "title",
    "write_base_diagnosis",
    "write_diagnosis",
]
