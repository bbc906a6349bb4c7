"""Python without POSIX, for processes that tests start.

Modules that Windows does not have cannot be imported, names that its ``os``, ``mmap``, ``signal`` and ``socket`` do not
have are gone, and ``msvcrt`` locks bytes as the C library of Windows does.
"""

from __future__ import annotations

import errno
import importlib
import mmap
import os
import signal
import socket
import sys
import time
import types

BUILT_FOR_THIS_SYSTEM = (
    "can canopen cantools foxglove llvmlite.binding matplotlib.figure mcap.reader numpy pydantic rich.progress "
    "scipy.linalg scipy.optimize scipy.signal scipy.stats serial.tools.list_ports sympy tempfile typer zenoh zstandard"
)
"""Others' packages have a build for each system; this one needs what it was built for."""
MODULES = ("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "syslog", "readline")
NAMES = {
    os: (
        "pread pwrite fdatasync openpty set_blocking ttyname getuid geteuid getgid getegid nice fork forkpty "
        "sched_getaffinity sched_setaffinity mkfifo fchmod fchown chown statvfs fstatvfs getloadavg eventfd sync "
        "killpg setsid getpgid O_CLOEXEC O_NONBLOCK O_NOFOLLOW O_DIRECTORY O_SYNC"
    ),
    mmap: "MADV_DONTNEED MADV_SEQUENTIAL PROT_READ MAP_SHARED",
    signal: "SIGHUP SIGUSR1 SIGUSR2 SIGALRM SIGKILL pthread_sigmask setitimer",
    socket: "AF_UNIX AF_CAN SOCK_CLOEXEC SOCK_SEQPACKET",
    time: "clock_gettime clock_gettime_ns CLOCK_MONOTONIC CLOCK_REALTIME CLOCK_MONOTONIC_RAW tzset",
}


def leave_posix(packages: str = BUILT_FOR_THIS_SYSTEM) -> None:
    """Makes this process such a one, where there is no way back; ``packages`` are others' that it may need later."""
    if sys.platform == "win32":
        return
    for name in packages.split():
        importlib.import_module(name)
    sys.modules["msvcrt"] = _msvcrt()
    for name in MODULES:
        sys.modules[name] = None  # type: ignore[assignment]
    for module, names in NAMES.items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)


def _msvcrt() -> types.ModuleType:
    """Locks as the module of Windows does, which knows exclusive locks only: EACCES where another has one."""
    module, fcntl = types.ModuleType("msvcrt"), importlib.import_module("fcntl")

    def locking(handle: int, mode: int, size: int) -> None:
        assert (mode, size, os.lseek(handle, 0, os.SEEK_CUR)) == (2, 1, (1 << 31) - 2)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise OSError(errno.EACCES, "Permission denied") from None

    module.LK_NBLCK, module.locking = 2, locking  # type: ignore[attr-defined]
    return module
