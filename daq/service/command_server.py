"""The server's side of the commands: they come on Zenoh's threads and wait for the one thread that owns the devices."""

from __future__ import annotations

import json
import queue
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError
from daq.service.client import COMMANDS, table_of
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh


class Command:
    """One command that somebody waits for; exactly one of ``answer`` and ``refuse`` ends it."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self.verb = str(query.key_expr).rpartition("/")[2]

    def arguments(self) -> dict[str, Any]:
        """The JSON object that came along; InputError if it is something else, or the verb is unknown."""
        if self.verb not in COMMANDS:
            raise InputError("daemon", f"no command {self.verb!r}; one of {', '.join(COMMANDS)} is wanted")
        payload = self._query.payload
        try:
            table = json.loads(payload.to_bytes()) if payload is not None and len(payload) else {}
        except ValueError as error:
            raise InputError("daemon", f"{self.verb}: arguments are not JSON: {error}") from None
        if not isinstance(table, dict):
            raise InputError("daemon", f"{self.verb}: arguments want to be a JSON object")
        return table

    def answer(self, table: dict[str, Any]) -> None:
        """Sends the result."""
        self._query.reply(self._query.key_expr, json.dumps(table), encoding="application/json")
        self._query.drop()

    def refuse(self, error: InputError | DeviceFault) -> None:
        """Sends the error, typed."""
        self._query.reply_err(json.dumps(table_of(error)), encoding="application/json")
        self._query.drop()


class CommandServer:
    """The queue of commands of one rig, and the liveliness token that says that somebody is there to answer."""

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        self._commands: queue.SimpleQueue[Command | None] = queue.SimpleQueue()
        self._queryable = session.declare_queryable(
            keys.command("*"), lambda query: self._commands.put(Command(query)), complete=True
        )
        self._token = session.liveliness().declare_token(keys.alive)

    def next(self, timeout: float | None = None) -> Command | None:
        """The next command, waiting at most ``timeout`` s (0: not at all; None: for ever); None if there was none."""
        try:
            return self._commands.get(timeout != 0, timeout)
        except queue.Empty:
            return None

    def wake(self) -> None:
        """Makes a waiting ``next`` return None; from any thread, or a signal handler (SimpleQueue.put is reentrant)."""
        self._commands.put(None)

    def close(self) -> None:
        """Takes back token and queryable; commands still waiting are refused."""
        self._token.undeclare()
        self._queryable.undeclare()
        while not self._commands.empty():
            if (command := self.next(0)) is not None:
                command.refuse(DeviceFault("daemon", "is stopping"))
