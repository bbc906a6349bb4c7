"""A folder of results that is written whole or not at all, so that no file of a run stands beside those of another."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from arm_io.errors import InputError
from arm_io.files import open_regular, read_text
from arm_io.results import check_file, check_folder, make_folder, write_text


@contextmanager
def whole_folder(path: str | PathLike[str], results: str) -> Iterator[Path]:
    """A folder to write ``results`` (``"diagnosis"``) in; when the block ends well, they move into ``path``.

    That is made if need be. Files of the same names there are replaced. Those that an earlier run wrote of the same
    results and this one did not are removed, unless they were changed since: a motion proposed by a verdict must not
    stand beside the next verdict. ``.RESULTS.files`` there says which they are. All others stay.

    Where the block fails or is interrupted, or something is where a file must go, ``path`` is as it was. InputError
    where it cannot be written.
    """
    path = Path(path)
    check_folder(path)
    # on the same disk, where files move at once
    there = path.absolute()
    while not there.exists():
        there = there.parent
    try:
        temporary = Path(tempfile.mkdtemp(dir=there, prefix=f".{path.name}", suffix=".part"))
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
    try:
        yield temporary
        _move(temporary, path, path / f".{results}.files")
    except InputError as error:
        raise InputError(str(error.where).replace(str(temporary), str(path)), error.what) from None
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _move(temporary: Path, path: Path, record: Path) -> None:
    """Moves all files of ``temporary`` into ``path``, in place of those that ``record`` names."""
    made = {file.relative_to(temporary).as_posix(): file for file in sorted(temporary.rglob("*")) if file.is_file()}
    folders = {path, *((path / name).parent for name in made)}
    for folder in folders:
        check_folder(folder)
    for place in [record, *(path / name for name in made)]:
        if place.parent.exists():
            check_file(place)
    before, written = _recorded(record), {name: _digest(file) for name, file in made.items()}
    for folder in sorted(folders):
        make_folder(folder)
    # until all files have been moved, the record names those of both runs
    _write(record, before | written)
    for name, digest in before.items():
        if name not in made and _digest(path / name) == digest:
            (path / name).unlink()
    for name, file in made.items():
        os.replace(file, path / name)
    _write(record, written)


def _recorded(record: Path) -> dict[str, str]:
    """Name -> digest of the files that an earlier run wrote; {} without a record, or with one that cannot be read."""
    try:
        found = json.loads(read_text(record))
    except ValueError:  # InputError is one
        return {}
    names = found if isinstance(found, dict) else {}
    return {name: digest for name, digest in names.items() if _is_below(name) and isinstance(digest, str)}


def _is_below(name: str) -> bool:
    """Whether a name stays in the folder that it is relative to."""
    return not Path(name).is_absolute() and ".." not in Path(name).parts


def _write(record: Path, files: dict[str, str]) -> None:
    write_text(record, json.dumps(files, indent=1) + "\n")


def _digest(file: Path) -> str:
    """SHA-256 of a regular file; "" where there is none."""
    if not file.is_file():
        return ""
    with os.fdopen(open_regular(file), "rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
