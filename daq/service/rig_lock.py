"""One process per rig: a lock file with the rig's name, held by a lock of the operating system.

The lock is released however its holder ends.
"""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from arm_io import DeviceFault
from arm_io.handles import PLAIN, read_at, try_lock, write_at
from daq.service.zenoh_session import keys_of


@dataclass(frozen=True)
class Holder:
    """Who has the rig: process id, and as what ('daemon' or 'record')."""

    pid: int
    role: str


def lock_path(rig: str) -> Path:
    """The lock file of the rig with that name, the same for all users of this machine: /run/lock where there is one."""
    folder = Path("/run/lock")
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        folder = Path(tempfile.gettempdir())
    return folder / f"armscope-{keys_of(rig).name}.lock"


def holder_of(rig: str) -> Holder | None:
    """Who has the rig now, or None."""
    try:
        handle = os.open(lock_path(rig), os.O_RDONLY | PLAIN)
    except FileNotFoundError:
        return None
    try:
        return None if try_lock(handle, shared=True) else _read(handle)
    finally:
        os.close(handle)


class RigLock:
    """The rig, taken.

    DeviceFault with the holder's process id if another process has it. The file remains; only the lock matters.
    """

    def __init__(self, rig: str, role: str) -> None:
        path = lock_path(rig)
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | PLAIN, 0o644)
        except PermissionError:
            raise DeviceFault("rig", f"{path} belongs to another user, who has used this rig; delete it") from None
        if not try_lock(self._handle):
            holder = _read(self._handle)
            os.close(self._handle)
            who = f"process {holder.pid} ({holder.role})" if holder else "another process"
            raise DeviceFault("rig", f"'{rig}' is in use by {who}; one process per rig")
        os.ftruncate(self._handle, 0)
        write_at(self._handle, json.dumps({"pid": os.getpid(), "role": role}).encode(), 0)

    def release(self) -> None:
        """Gives the rig back; a second call does nothing."""
        if self._handle >= 0:
            os.ftruncate(self._handle, 0)
            os.close(self._handle)
            self._handle = -1


def _read(handle: int) -> Holder | None:
    try:
        table = json.loads(read_at(handle, 1000, 0))
        return Holder(int(table["pid"]), str(table["role"]))
    except (ValueError, KeyError, TypeError):
        return None
