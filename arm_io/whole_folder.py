"""A folder of results that is written whole or not at all, so that no file of a run stands beside those of another."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from arm_io.errors import InputError
from arm_io.results import check_folder, make_folder


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """A folder to write results in; when the block ends well, they move into ``path``, which is made if need be.

    Files of the same names there are replaced, others stay. Where the block fails or is interrupted, ``path`` is as it
    was. InputError where it cannot be written.
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
        make_folder(path)
        for file in sorted(one for one in temporary.rglob("*") if one.is_file()):
            place = path / file.relative_to(temporary)
            make_folder(place.parent)
            os.replace(file, place)
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
