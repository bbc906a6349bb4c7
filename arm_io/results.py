"""Where results go: a folder that a person names, and files in it, each whole or not at all."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from arm_io.errors import InputError

LONGEST_NAME = 230
"""Bytes of a file's name: 255 of the file system, less what is appended until the file is whole."""


def check_file(path: str | Path) -> None:
    """Raises InputError where no regular file can be at ``path``: at a folder, a device, a pipe, a name that is none.

    For ahead of long work; makes nothing. A file that is there is no error: who must not replace it asks for itself.
    """
    name = os.path.basename(path)
    if name in ("", ".", ".."):
        raise InputError(path or "output", "is not the name of a file")
    mode = _mode(path)
    if mode is not None and stat.S_ISDIR(mode):
        raise InputError(path, "is a folder; the name of a file is needed")
    if mode is not None and not stat.S_ISREG(mode):
        raise InputError(path, "is a pipe, socket or device; the name of a regular file is needed")
    if len(os.fsencode(name)) > LONGEST_NAME:
        raise InputError(path, f"the name is longer than {LONGEST_NAME} bytes")
    parent = _mode(Path(path).parent)
    if parent is None or not stat.S_ISDIR(parent):
        raise InputError(path, f"cannot be written: there is no folder {Path(path).parent}")


def check_folder(path: str | Path) -> None:
    """Raises InputError unless ``path`` is a folder to write in, or can become one; leaves nothing behind."""
    path = Path(path)
    nearest = path.absolute()
    while (mode := _mode(nearest)) is None:
        if len(os.fsencode(nearest.name)) > LONGEST_NAME:
            raise InputError(path, f"the name is longer than {LONGEST_NAME} bytes")
        nearest = nearest.parent
    if not stat.S_ISDIR(mode):
        raise InputError(path, "is a file; expected a folder for the results")
    try:
        os.rmdir(tempfile.mkdtemp(dir=nearest))  # permissions alone do not tell
    except OSError as error:
        raise InputError(path, f"cannot be made in {nearest}: {error.strerror}") from None


def _mode(path: str | Path) -> int | None:
    """Of what is at ``path``, None where nothing is. InputError for a path that cannot be one."""
    try:
        return os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:  # ValueError: a NUL, a lone surrogate
        raise InputError(ascii(str(path)), f"cannot be used: {getattr(error, 'strerror', None) or error}") from None


def make_folder(path: str | Path) -> None:
    """Makes the folder, and those above it; InputError where that cannot be."""
    check_folder(path)
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(path, f"cannot be made: {error.strerror}") from None


def write_text(path: str | Path, text: str) -> None:
    """Writes a text file, whole or not at all; InputError where that cannot be."""
    with whole_file(path) as file:
        file.write(text)


@contextmanager
def whole_file(path: str | Path) -> Iterator[IO[str]]:
    """Opens a text file for writing that appears whole or not at all; line ends are written as given.

    The text goes to a temporary file, which takes the name ``path`` when the block ends without an exception.

    InputError where it cannot be written.
    """
    check_file(path)
    path = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            yield file
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise InputError(path, f"cannot be written: {error.strerror}") from None
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


@contextmanager
def whole_path(path: str | Path, *, folder: bool = False) -> Iterator[Path]:
    """A path to write a file to (``folder``: to make a folder at), by a library that takes names.

    There when the block ends well, else not at all. InputError where it cannot be written, or the folder is there
    already.
    """
    path = Path(path)
    if folder:
        check_folder(path)
        if path.exists():
            raise InputError(path, "exists already; give the name of a new folder")
    else:
        check_file(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=f"{path.name}.", suffix=".part") as place:
            yield (made := Path(place, path.name))
            os.replace(made, path)
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror or error}") from None
