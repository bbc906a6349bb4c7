"""Where results go: a folder that a person names, and files in it, each whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from arm_io.errors import InputError


def check_folder(path: str | Path) -> None:
    """Raises InputError where ``path`` neither is a folder to write in nor can become one; for ahead of long work, makes nothing."""
    path = Path(path)
    nearest = path.absolute()
    while not nearest.exists():
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(path, "is a file; expected a folder for the results")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(path, f"cannot be written: no permission in {nearest}")


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
    """A text file to write, lines as they are given; there when the block ends well (temporary file, then rename), else not at all.

    InputError where it cannot be written.
    """
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
