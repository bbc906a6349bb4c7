"""The files of a comparison: compare.json and compare.html, each whole or not at all."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io import make_folder, write_text
from comparison.report.html import report

if TYPE_CHECKING:
    from comparison.outcome import Comparison


def write_comparison(folder: str | PathLike[str], result: Comparison) -> dict[str, Any]:
    """Writes the files into ``folder`` (made if need be) and returns what compare.json says."""
    folder = Path(folder)
    make_folder(folder)
    table = result.to_json()
    write_text(folder / "compare.html", report(result))
    write_text(folder / "compare.json", json.dumps(table, indent=1, allow_nan=False) + "\n")
    return table
