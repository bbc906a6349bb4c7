"""Who serves a rig: a daemon, here or on another machine, or ourselves for the time of one recording."""

from __future__ import annotations

import contextlib
import sys
import time
from pathlib import Path
from typing import Any, Protocol

from arm_io import InputError
from daq.rig.preflight import ChainReader
from daq.rig.rig_file import Rig
from daq.service.client import ARM_SECONDS, call, claim
from daq.service.rig_lock import holder_of
from daq.service.zenoh_session import keys_of, open_session

Table = dict[str, Any]
ANSWER_SECONDS = 30.0
WAIT_SECONDS = 0.05


class RigServer(Protocol):
    """Takes the commands of docs/daemon.md."""

    def ask(self, verb: str, arguments: Table | None = None) -> Table: ...
    def wait(self) -> None: ...
    def close(self) -> None: ...


def server_of(path: Path, rig: Rig, read_chain: ChainReader | None) -> RigServer:
    """The daemon that has the rig of the file ``path``.

    An embedded one where there is none and the rig is this machine's; ``read_chain`` as of ``Service``.
    InputError while another process records on it.
    """
    holder = holder_of(rig.name)
    if holder is not None and holder.role == "record":
        raise InputError(path, f"rig '{rig.name}' is recording now (process {holder.pid}); one run at a time")
    if holder is not None or not rig.zenoh.loopback:
        return RemoteServer(rig)
    return EmbeddedServer(path, read_chain)


class RemoteServer:
    """A daemon that answers on the rig's endpoint. What this client armed is disarmed when it closes, or dies."""

    def __init__(self, rig: Rig) -> None:
        self.keys = keys_of(rig.name)
        self.session = open_session(rig, listen=False)
        self._held = contextlib.ExitStack()
        self._name = self._held.enter_context(claim(self.session, self.keys))

    def ask(self, verb: str, arguments: Table | None = None) -> Table:
        seconds = ANSWER_SECONDS
        if verb == "arm":
            arguments, seconds = {**(arguments or {}), "client": self._name}, ARM_SECONDS
        return call(self.session, self.keys, verb, arguments, timeout=seconds)

    def wait(self) -> None:
        time.sleep(WAIT_SECONDS)

    def close(self) -> None:
        self._held.close()
        self.session.close()


class EmbeddedServer:
    """A service of our own."""

    def __init__(self, path: Path, read_chain: ChainReader | None = None) -> None:
        from daq.service.service import Service

        self._service = Service(path, role="record", publish="optional", read_chain=read_chain)
        self._service.open()
        for note in self._service.notes:
            print(f"note: {note}", file=sys.stderr)

    def ask(self, verb: str, arguments: Table | None = None) -> Table:
        return self._service.ask(verb, arguments)

    def wait(self) -> None:
        self._service.step(WAIT_SECONDS)
        if self._service.lifecycle.bug is not None:
            raise self._service.lifecycle.bug

    def close(self) -> None:
        self._service.close()
