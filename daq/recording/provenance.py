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

from mcap.reader import make_reader

from arm_io import InputError
from arm_io.files import open_regular
from daq.recording.mcap_file.checksums import MAGIC
from daq.recording.messages.row_format import format_of

_PACKAGES = ("armscope", "numpy", "scipy", "mcap", "zstandard", "eclipse-zenoh")
TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".parquet", ".pq", ".mat", ".h5", ".hdf5", ".xlsx", ".db3")
"""Of files of other programs, by which those open them."""


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


def is_measured(path: str | Path) -> bool:
    """Whether a file is an MCAP file of measured rows, which cannot be made again, unlike imported and simulated ones.

    True also of one that is damaged, and of an MCAP file of another program. InputError where it cannot be read.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return False
        file.seek(0)
        try:
            summary = make_reader(file).get_summary()
            channels = summary.channels.values() if summary else []
            layouts = [format_of(one.metadata["layout"]).layout for one in channels if "layout" in one.metadata]
        except Exception:  # the library raises anything over a damaged file
            return True
    return not layouts or any(layout.raw for layout in layouts)


def check_replaceable(path: str | Path, *, measured: bool = False) -> None:
    """InputError where something is at ``path`` that a recording must not replace.

    That is all but an imported or simulated recording, which can be made again, and an empty file.

    measured  replace any recording
    """
    if not os.path.isfile(path) or not os.path.getsize(path):
        check_ending(path)
        return
    if not measured and is_measured(path):
        raise InputError(path, "exists already, and no recording of a rig is overwritten; use another name")
    with os.fdopen(open_regular(path), "rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(path, "exists already and is no recording; only recordings are replaced; use another name")


def check_ending(path: str | Path) -> None:
    """InputError where a recording would have the name of a table, which no other program could open."""
    name = Path(path)
    if name.suffix.lower() in TABLE_ENDINGS:
        mcap = name.with_suffix(".mcap")
        raise InputError(path, f"a recording is an MCAP file: name it {mcap}; 'armscope export' makes tables of it")


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
