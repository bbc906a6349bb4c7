"""What every report is made of: charts, tables, templates, one palette, and the writing of its files.

The pages open anywhere, without a network: scripts, styles and data stand inside. Colours: ``arm_report.palette``.
"""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_report.chart import Chart, Level, Panel, Series, Zone
    from arm_report.notebook import image, inline
    from arm_report.page import Report, table, warning
    from arm_report.paper import figure
    from arm_report.terminal_table import cut, line_width, text_table
    from arm_report.wrapped_text import wrapped
    from arm_report.write import write_report
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Chart",
    "Level",
    "Panel",
    "Report",
    "Series",
    "Zone",
    "cut",
    "figure",
    "image",
    "inline",
    "line_width",
    "table",
    "text_table",
    "warning",
    "wrapped",
    "write_report",
]
