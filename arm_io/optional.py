"""Packages that only some commands need, installed by name of an extra (``pip install 'armscope[parquet]'``)."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from arm_io.errors import InputError


def optional(module: str, extra: str, where: str | Path) -> Any:
    """The module; InputError with what to install where it is not there. ``where`` is the file that needs it."""
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise InputError(where, f"needs the package {package}: pip install 'armscope[{extra}]'") from None
