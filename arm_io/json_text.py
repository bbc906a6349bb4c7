"""Results as JSON, with finite numbers only: JSON has neither NaN nor infinity, and readers refuse a file with one."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arm_io.errors import InputError
from arm_io.results import write_text


def json_text(content: Any, where: str | Path = "result", indent: int | None = None) -> str:
    """Content as JSON; numbers of numpy as numbers. InputError that names the first one that is not finite."""
    try:
        return json.dumps(content, indent=indent, default=float, allow_nan=False)
    except ValueError:
        for wrong in _not_finite(content):
            raise InputError(where, wrong) from None
        raise


def write_json(path: str | Path, content: Any, indent: int | None = None) -> None:
    """Writes a JSON file, whole or not at all. InputError where that cannot be, or a number is not finite."""
    write_text(path, json_text(content, path, indent) + "\n")


def _not_finite(value: Any, name: str = "") -> Iterator[str]:
    """A sentence for each number that is not finite; entries of lists are numbered from 1."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _not_finite(entry, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple):
        for number, entry in enumerate(value, 1):
            yield from _not_finite(entry, f"{name}[{number}]")
    elif value is not None and not isinstance(value, str) and not math.isfinite(value):
        yield f"{name} must be a finite number (is {float(value):g}): these recordings do not determine it"
