"""The three files of an identification: identification.json, report.html, model.toml; each whole or not at all."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io import make_folder, write_text
from arm_model import write_model
from identification.report.html import report

if TYPE_CHECKING:
    from identification.result import Identification


def write_identification(folder: str | PathLike[str], result: Identification) -> dict[str, Any]:
    """Writes the files into ``folder`` (made if need be) and returns what identification.json says."""
    folder = Path(folder)
    make_folder(folder)
    table = result.to_json()
    write_text(folder / "report.html", report(result))
    heading = f"Identified by armscope ({result.method}) from {', '.join(Path(p).name for p in result.fit)}."
    write_model(folder / "model.toml", result.arm, heading=heading)
    write_text(folder / "identification.json", json.dumps(table, indent=1) + "\n")
    return table
