"""What every report is made of: one page skeleton and style, tables, pictures with their data inside, one palette.

The pages open anywhere, without a network. Colours: ``arm_report.palette``.
"""

from arm_report.image import image
from arm_report.page import note, page, verdict, warning
from arm_report.table import table

__all__ = ["image", "note", "page", "table", "verdict", "warning"]
