"""The three files of an identification: identification.json, report.html, model.toml; each whole or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from arm_model.description import write_model
from identification.report import report
from identification.result import Identification
from inputs import InputError


def write_identification(folder: str | Path, result: Identification) -> dict[str, Any]:
    """Writes the files into ``folder`` (made if need be) and returns what identification.json says."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise InputError(folder, "is a file; a folder for the results is wanted") from None
    except OSError as error:
        raise InputError(folder, f"cannot be made: {error.strerror}") from None
    table = result.to_json()
    try:
        _write(folder / "report.html", report(result))
        heading = f"Identified by armscope ({result.method}) from {', '.join(Path(p).name for p in result.fit)}."
        write_model(folder / "model.toml", result.arm, heading=heading)
        _write(folder / "identification.json", json.dumps(table, indent=1) + "\n")
    except OSError as error:
        raise InputError(folder, f"cannot be written: {error.strerror}") from None
    return table


def _write(path: Path, text: str) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
