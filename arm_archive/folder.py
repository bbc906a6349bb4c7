"""Finds the recordings and results in the folder of an archive, with the state of the files that describe each."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from arm_archive.entries import RECORDING, RESULTS
from arm_io import InputError

BESIDE = ("model.toml", "report.html", "compare.html")
"""Files in the folder of a result on which its entry depends."""
RACY = 2 * 10**9
"""ns, coarsest resolution of file times (FAT: 2 s). A file that was changed this shortly before it was read may have
changed again since, without a trace in its time."""


@dataclass(frozen=True)
class Found:
    """One recording or result.

    path     relative to the folder of the archive, with /
    stamp    size and time of the file and of the other files on which its entry depends; equal: nothing changed
    changed  ns since 1970, the latest change of any of them
    size     bytes of the file
    """

    path: str
    kind: str
    stamp: str
    changed: int
    size: int


def files_in(folder: Path) -> Iterator[Found]:
    """Every recording and result below a folder, sorted by path within each folder.

    Hidden folders and linked folders are left out. InputError where ``folder`` itself cannot be read; a folder below
    it that cannot be read is left out.
    """
    try:
        os.scandir(folder).close()
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror}; must be a folder of recordings") from None
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        inside = set(names)
        for name in sorted(names):
            kind = RECORDING if name.endswith((".mcap", ".mcap.active")) else RESULTS.get(name)
            if kind is not None and _is_text(name) and _is_text(place):
                beside = () if kind == RECORDING else [other for other in BESIDE if other in inside]
                found = _found(folder, Path(place, name), kind, beside)
                if found is not None:
                    yield found


def _is_text(name: str) -> bool:
    """Whether a name can be stored in the index: it must be UTF-8."""
    return not any("\ud800" <= letter <= "\udfff" for letter in name)


def _found(folder: Path, path: Path, kind: str, beside: list[str] | tuple[()]) -> Found | None:
    """State of a file; None if it has disappeared meanwhile."""
    stamps, changed, size = [], 0, 0
    for one in (path, *(path.parent / name for name in beside)):
        try:
            state = one.stat()
        except OSError:
            if one == path:
                return None
            continue
        stamps.append(f"{one.name} {state.st_size} {state.st_mtime_ns}")
        changed = max(changed, state.st_mtime_ns)
        size = state.st_size if one == path else size
    return Found(path.relative_to(folder).as_posix(), kind, "; ".join(stamps), changed, size)
