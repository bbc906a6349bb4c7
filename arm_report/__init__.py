"""What every report is made of: one page skeleton and style, tables, pictures with their data inside, one palette.

The pages open anywhere, without a network. Colours: ``arm_report.palette``.
"""

from arm_report.image import image
from arm_report.inline import inline
from arm_report.page import note, page, verdict, warning
from arm_report.table import table
from arm_report.text_table import cut, line_width, text_table
from arm_report.wrapped import wrapped

__all__ = [
    "cut",
    "image",
    "inline",
    "line_width",
    "note",
    "page",
    "table",
    "text_table",
    "verdict",
    "warning",
    "wrapped",
]
