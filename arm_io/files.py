"""Files from outside, opened so that nothing waits and nothing surprises: regular files only, whole, of bounded size.

A FIFO or a terminal named as an input would make the program wait for ever; a file of ``/proc`` or ``/dev`` may have no
end.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from arm_io.errors import InputError
from arm_io.handles import NOT_BLOCKING, PLAIN

MOST_TEXT = 64 << 20
"""Bytes of a text that is read at once.

The largest rig file of a laboratory has 10 kB, a day of setpoints at 1 Hz 6 MB.
"""


def open_regular(path: str | Path) -> int:
    """A file descriptor to read a regular file with; the caller closes it.

    Raises InputError where there is none, it cannot be read, or is a folder, FIFO, socket or device.
    """
    try:
        handle = os.open(path, os.O_RDONLY | PLAIN | NOT_BLOCKING)
    except FileNotFoundError:
        raise InputError(path, "no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        if os.path.isdir(path):  # which Windows does not open
            raise InputError(path, "is a folder; the name of a file is needed") from None
        raise InputError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    mode = os.fstat(handle).st_mode
    if not stat.S_ISREG(mode):
        os.close(handle)
        kind = "a folder" if stat.S_ISDIR(mode) else "not a regular file (a pipe, socket or device)"
        raise InputError(path, f"is {kind}; the name of a file is needed")
    return handle


def read_file(path: str | Path, *, most: int = MOST_TEXT) -> bytes:
    """All bytes of a regular file.

    InputError as ``open_regular``, and where it is larger than ``most`` bytes or reading fails.
    """
    with os.fdopen(open_regular(path), "rb", buffering=0) as file:
        parts: list[bytes] = []
        left = most + 1
        try:
            while left > 0 and (part := os.read(file.fileno(), min(left, 1 << 20))):
                parts.append(part)
                left -= len(part)
        except OSError as error:
            raise InputError(path, f"cannot be read: {error.strerror}") from None
    if left <= 0:
        raise InputError(path, f"is larger than {most >> 20} MB")
    return b"".join(parts)


def read_head(path: str | Path, size: int) -> bytes:
    """The first ``size`` bytes of a regular file, or all of a shorter one. InputError as ``open_regular``."""
    with os.fdopen(open_regular(path), "rb") as file:
        try:
            return file.read(size) or b""  # None: a special file that has nothing to read yet
        except OSError as error:
            raise InputError(path, f"cannot be read: {error.strerror}") from None


def read_text(path: str | Path) -> str:
    """The text of a regular file in UTF-8, word for word. InputError as ``read_file``, and where it is not UTF-8."""
    data = read_file(path, most=MOST_TEXT)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        if data.startswith(b"\x89MCAP"):
            raise InputError(path, "is a recording (MCAP); a text file is expected here") from None
        raise InputError(path, f"is not text in UTF-8: byte {error.start + 1} is 0x{data[error.start]:02x}") from None
