"""Scripts of others that reports and the control room share: one copy of uPlot."""

from pathlib import Path

VENDOR = Path(__file__).parent / "static" / "vendor"
"""Folder of uplot.js (a module), uplot.css and their licence."""
