"""Open files by descriptor, alike on POSIX and on Windows: reads and writes in place, locks, waiting for the disk.

POSIX has calls for all of this. Windows has ``msvcrt``, and no positioned reads and writes: there the position is moved
and the bytes follow, one thread at a time.
"""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path
from types import ModuleType

_fcntl: ModuleType | None
try:
    import fcntl as _fcntl
except ImportError:  # Windows
    _fcntl = None

PLAIN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""Flags of ``os.open``: no child inherits the descriptor, and no byte is translated."""
NOT_BLOCKING = getattr(os, "O_NONBLOCK", 0)
NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_LOCKED_BYTE = (1 << 31) - 2
"""Windows refuses others to read what is locked: the last byte that every C library can name, behind most files."""
_moving = threading.Lock()


def read_at(handle: int, size: int, offset: int) -> bytes:
    """At most ``size`` bytes from ``offset`` on; b"" at the end. OSError as ``os.pread``."""
    if hasattr(os, "pread"):
        return os.pread(handle, size, offset)
    with _moving:
        os.lseek(handle, offset, os.SEEK_SET)
        return os.read(handle, size)


def write_at(handle: int, data: bytes | memoryview, offset: int) -> int:
    """Writes at ``offset``; returns how many bytes were taken. OSError as ``os.pwrite``."""
    if hasattr(os, "pwrite"):
        return os.pwrite(handle, data, offset)
    with _moving:
        os.lseek(handle, offset, os.SEEK_SET)
        return os.write(handle, data)


def to_disk(handle: int) -> None:
    """Waits until everything written is on the disk. OSError where the disk refuses."""
    getattr(os, "fdatasync", os.fsync)(handle)


def folder_to_disk(folder: Path) -> None:
    """Waits until the names in a folder are on the disk; Windows offers no way to, and needs none."""
    if _fcntl is None:
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def try_lock(handle: int, *, shared: bool = False) -> bool:
    """Locks an open file against other processes until it is closed; False where another has locked it.

    shared  beside other shared locks; Windows has none, and locks it alone
    OSError where the file system has no locks.
    """
    try:
        if _fcntl is not None:
            _fcntl.flock(handle, (_fcntl.LOCK_SH if shared else _fcntl.LOCK_EX) | _fcntl.LOCK_NB)
        else:
            import msvcrt

            with _moving:
                os.lseek(handle, _LOCKED_BYTE, os.SEEK_SET)
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
            return False
        raise
    return True
