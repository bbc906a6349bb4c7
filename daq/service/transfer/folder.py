"""The folder in which a daemon records for clients on other machines, and from which they fetch.

Clients name files in it by plain names only, without folders.
"""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path
from typing import Any

from arm_io import InputError
from arm_io.handles import NO_LINK, NOT_BLOCKING, PLAIN, read_at
from daq.recording.mcap_file.pages import ACTIVE

SUFFIX = ".mcap"
MOST_PIECE = 1 << 18
"""Bytes of one answer to ``read``."""
_BLOCK = 1 << 20
_LONGEST_NAME = 255 - len(ACTIVE)
"""Bytes: while it is written, the file's name is longer."""


def check_name(name: str) -> str:
    """``name``, if it can be that of a file in any folder; InputError otherwise."""
    try:
        length = len(os.fsencode(name))
    except UnicodeEncodeError:
        raise InputError("daemon", "out: holds characters that no file name can have") from None
    if not name.isprintable():
        raise InputError("daemon", "out: holds characters that no file name should have")
    if length > _LONGEST_NAME:
        raise InputError("daemon", f"out: a file name of {length} bytes; at most {_LONGEST_NAME}")
    return name


class RecordingsFolder:
    """Recordings by plain name. Every refusal is an InputError."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        self._sums: dict[tuple[str, int, int], str] = {}

    def place(self, name: str) -> Path:
        """Where a new recording of this name goes."""
        check_name(name)
        if Path(name).name != name or name.startswith(".") or not name.endswith(SUFFIX):
            raise InputError(
                "daemon", f"out: must be a plain name like run{SUFFIX}; recordings of this daemon go to {self.path}"
            )
        return self.path / name

    def list(self) -> list[dict[str, Any]]:
        """Name, bytes and time of the last change (ns since the epoch) of each recording, the newest first."""
        entries = []
        with os.scandir(self.path) as found:
            for entry in found:
                if _is_name(entry.name) and entry.is_file(follow_symlinks=False):
                    status = entry.stat(follow_symlinks=False)
                    entries.append({"name": entry.name, "bytes": status.st_size, "changed_ns": status.st_mtime_ns})
        return sorted(entries, key=lambda entry: (-int(entry["changed_ns"]), entry["name"]))

    def checksum(self, name: str) -> dict[str, Any]:
        """Bytes and SHA-256 of a recording; computed once for each state of a file."""
        handle, status = self._open(name)
        with os.fdopen(handle, "rb") as file:
            key = name, status.st_size, status.st_mtime_ns
            if key not in self._sums:
                digest = hashlib.sha256()
                left = status.st_size  # what is appended meanwhile is not part of it
                while left > 0 and (block := file.read(min(_BLOCK, left))):
                    digest.update(block)
                    left -= len(block)
                self._sums = {key: digest.hexdigest()}
        return {"name": name, "bytes": status.st_size, "sha256": self._sums[key]}

    def read(self, name: str, offset: int, length: int) -> bytes:
        """At most ``length`` bytes from ``offset`` on; fewer at the end of the file."""
        handle, _ = self._open(name)
        try:
            return read_at(handle, min(length, MOST_PIECE), offset)
        finally:
            os.close(handle)

    def _open(self, name: str) -> tuple[int, os.stat_result]:
        if not _is_name(name):
            raise InputError("daemon", f"{name[:60]!r} is no plain name of a recording, like run{SUFFIX}")
        try:
            # No links: they could lead out of the folder. Not blocking: a FIFO would wait for its writer.
            handle = os.open(self.path / name, os.O_RDONLY | NO_LINK | NOT_BLOCKING | PLAIN)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "not a file name"
            raise InputError("daemon", f"{name[:60]}: no such recording ({reason})") from None
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            os.close(handle)
            raise InputError("daemon", f"{name[:60]}: is not a recording")
        return handle, status


def _is_name(name: str) -> bool:
    """Whether it is a plain name of a recording."""
    plain = Path(name).name == name and not name.startswith(".") and name.isprintable()
    return plain and name.endswith((SUFFIX, SUFFIX + ACTIVE))
