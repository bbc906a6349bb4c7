"""Where a recording comes from: what made it, when, on which machine, with which versions, from which files."""

from __future__ import annotations

import getpass
import hashlib
import os
import platform
import sys
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from arm_io.files import open_regular

_PACKAGES = ("armscope", "numpy", "scipy", "mcap", "zstandard", "eclipse-zenoh")


def provenance(kind: str, **details: Any) -> dict[str, Any]:
    """The table for ``Attachments.provenance``. kind: 'measured', 'imported' or 'simulated'; ``details`` are added."""
    return {
        "kind": kind,
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": " ".join([_program(), *sys.argv[1:]]),
        "host": platform.node(),
        "user": _user(),
        "platform": platform.platform(),
        "versions": {"python": platform.python_version()} | {name: _version(name) for name in _PACKAGES},
        **details,
    }


def file_identity(path: str | Path) -> dict[str, Any]:
    """A source file's name, size and content hash."""
    with os.fdopen(open_regular(path), "rb") as file:
        return {
            "name": Path(path).name,
            "sha256": hashlib.file_digest(file, "sha256").hexdigest(),
            "bytes": os.fstat(file.fileno()).st_size,
        }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _program() -> str:
    program = Path(sys.argv[0])
    return program.parent.name if program.name == "__main__.py" else program.name


def _user() -> str:
    try:
        return getpass.getuser()
    except (ImportError, OSError, KeyError):  # Windows has no pwd
        return "unknown"
