"""What ``plot`` returns is shown by a notebook that nobody told about matplotlib."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from arm_report.chart import Chart, Panel, Series
from arm_report.paper import figure

SCRIPT = """
from IPython.core.interactiveshell import InteractiveShell
from arm_report.chart import Chart, Panel, Series
from arm_report.paper import figure

panel = Panel(series=(Series(x=[0.0, 1.0], y=[0.0, 1.0], colour="black", label=""),), title="", x="", y="")
drawn = figure(Chart(name="a", title="a", panels=(panel,), columns=1, height=2.0))
shell = InteractiveShell.instance()
shell.display_formatter.active_types = ["text/plain", "image/png"]
shown, _ = shell.display_formatter.format(drawn)
import sys
assert shown["image/png"][:4] == b"\\x89PNG" and "matplotlib.pyplot" not in sys.modules
"""


def test_rows_have_whole_numbers() -> None:
    rows = np.arange(1.0, 21.0)
    panel = Panel(series=(Series(x=rows, y=rows, colour="black", label=""),), title="", x="row", y="")
    (axis,) = figure(Chart(name="a", title="a", panels=(panel,), columns=1, height=2.0)).axes
    assert all(tick == round(tick) for tick in axis.get_xticks())


def test_a_figure_is_an_image_in_a_notebook() -> None:
    pytest.importorskip("IPython")
    subprocess.run([sys.executable, "-c", SCRIPT], check=True, timeout=120)
