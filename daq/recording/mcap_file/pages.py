"""A file as bytes in memory, of which only what is being looked at stays there."""

from __future__ import annotations

import mmap
import os
from pathlib import Path

from arm_io import InputError
from arm_io.files import open_regular

ACTIVE = ".active"
"""Ends the name of a recording that is not finished."""
WINDOW = 1 << 22
"""Bytes of a file that are held in memory while it is read from beginning to end."""


def mapped(path: Path) -> memoryview:
    """The bytes of a file, mapped into memory as long as anybody holds them. InputError where it cannot be read."""
    try:
        handle = open_regular(path)
    except InputError as error:
        if os.path.isfile(os.path.join(path, "metadata.yaml")):
            raise InputError(path, "is a ROS 2 bag; 'armscope import' makes a recording of it") from None
        active = f"{path}{ACTIVE}"
        hint = f"; {active} is unfinished and can be read" if os.path.isfile(active) else ""
        raise InputError(path, error.what + hint) from None
    try:
        with os.fdopen(handle, "rb") as file:
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except ValueError:
        raise InputError(path, "is empty; it must be a recording") from None
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from None


def release(data: memoryview, start: int, end: int) -> int:
    """Gives the memory of bytes ``start`` to ``end`` of a mapped file back to the system, if it is ``WINDOW`` or more.

    The bytes can still be read: the system loads them again.

    Returns where the bytes that are still held begin.
    """
    if end - start < WINDOW:
        return start
    first, last = (place // mmap.PAGESIZE * mmap.PAGESIZE for place in (start, end))
    if isinstance(data.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):  # not on Windows
        data.obj.madvise(mmap.MADV_DONTNEED, first, last - first)
    return last
