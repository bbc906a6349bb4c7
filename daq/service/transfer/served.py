"""The commands that read a daemon's folder: on a thread of their own, for a disk may be slow and a file long."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any

from arm_io import InputError
from daq.service.commands.arguments import NameArguments, NoArguments, ReadArguments, checked
from daq.service.process.worker import Worker
from daq.service.transfer.folder import RecordingsFolder

Table = dict[str, Any]


class ServedFolder:
    """``recordings``, ``checksum`` and ``read`` of docs/daemon.md. Every method raises InputError where it refuses.

    folder  the folder; None: there is none, and every command is refused
    """

    def __init__(self, path: Path | None) -> None:
        self.folder = None if path is None else RecordingsFolder(path)
        self._worker: Worker | None = None

    def open(self, done: Callable[[], None]) -> None:
        """Begins; ``done`` as in ``Worker``."""
        self._worker = Worker("files", done)

    def close(self) -> None:
        """Waits for what is being read."""
        if self._worker is not None:
            self._worker.close()

    def recordings(self, arguments: Table) -> Future[Table]:
        """What is there."""
        checked("recordings", arguments, NoArguments)
        folder, worker = self._both()
        return worker.submit(lambda: {"folder": str(folder.path), "recordings": folder.list()})

    def checksum(self, arguments: Table) -> Future[Table]:
        """Bytes and SHA-256 of one."""
        wanted = checked("checksum", arguments, NameArguments)
        folder, worker = self._both()
        return worker.submit(partial(folder.checksum, wanted.name))

    def read(self, arguments: Table) -> Future[bytes]:
        """A piece of one."""
        wanted = checked("read", arguments, ReadArguments)
        folder, worker = self._both()
        return worker.submit(partial(folder.read, wanted.name, wanted.offset, wanted.length))

    def _both(self) -> tuple[RecordingsFolder, Worker]:
        if self.folder is None or self._worker is None:
            raise InputError(
                "daemon", "has no folder for recordings (--recordings); it writes where 'record --out' says"
            )
        return self.folder, self._worker
