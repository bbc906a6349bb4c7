"""The server's side of the commands: they come on Zenoh's threads and wait for the one thread that obeys them.

Answers leave on a thread of their own: where a client has stopped reading, Zenoh waits for it (``send_seconds`` of
``daq.service.zenoh_session.open_session``, then its connection is closed), and no command may wait with it.
"""

from __future__ import annotations

import contextlib
import json
import traceback
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError
from daq.service.client import COMMANDS, table_of
from daq.service.commands import strict_json
from daq.service.commands.queue import CommandQueue
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh

MOST_BYTES = {"arm": 4 << 20}
"""Verb -> bytes of arguments that it takes: an experiment may hold a table of setpoints."""
MOST_BYTES_OTHERWISE = 1 << 16


class Command:
    """One command whose client waits; exactly one of ``answer`` and ``refuse`` ends it."""

    def __init__(self, query: zenoh.Query, answers: Executor) -> None:
        self._query, self._answers = query, answers
        self.verb = str(query.key_expr).rpartition("/")[2]

    def check(self) -> None:
        """Raises InputError where the verb is unknown or the arguments are too long; looks at nothing else."""
        if self.verb not in COMMANDS:
            raise InputError("daemon", f"no command {self.verb[:40]!r}; there are {', '.join(COMMANDS)}")
        most = MOST_BYTES.get(self.verb, MOST_BYTES_OTHERWISE)
        payload = self._query.payload
        if payload is not None and len(payload) > most:
            raise InputError("daemon", f"{self.verb}: {len(payload)} bytes of arguments; at most {most}")

    def arguments(self) -> dict[str, Any]:
        """The JSON object that came along; InputError if it is something else, too long, or the verb is unknown."""
        self.check()
        payload = self._query.payload
        return strict_json.parse(b"" if payload is None else payload.to_bytes(), f"daemon: {self.verb}")

    def answer(self, result: dict[str, Any] | bytes) -> None:
        """Sends the result: a table as JSON; a piece of a file as it is, at once, on the thread that has read it."""
        key = self._query.key_expr
        if isinstance(result, bytes):
            self._send(lambda: self._query.reply(key, result, encoding="application/octet-stream"))
        else:
            text = json.dumps(result)
            self._later(lambda: self._query.reply(key, text, encoding="application/json"))

    def refuse(self, error: InputError | DeviceFault) -> None:
        """Sends the error, typed."""
        text = json.dumps(table_of(error))
        self._later(lambda: self._query.reply_err(text, encoding="application/json"))

    def settle(self, outcome: Future[dict[str, Any]] | Future[bytes]) -> None:
        """Sends the outcome. An exception that is neither InputError nor DeviceFault is a bug, and reported as one."""
        error = outcome.exception()
        if error is None:
            self.answer(outcome.result())
        elif isinstance(error, InputError | DeviceFault):
            self.refuse(error)
        else:
            traceback.print_exception(error)
            self.refuse(DeviceFault("daemon", f"{self.verb}: a bug: {type(error).__name__}: {error}"))

    def _later(self, send: Callable[[], None]) -> None:
        self._answers.submit(self._send, send)

    def _send(self, send: Callable[[], None]) -> None:
        import zenoh

        with contextlib.suppress(zenoh.ZError):  # the client has disconnected
            send()
        self._query.drop()


class CommandServer:
    """The queue of commands of one rig, and the liveliness token of a process that answers."""

    def __init__(self, session: zenoh.Session, keys: Keys, waiting: CommandQueue | None = None) -> None:
        self._waiting = CommandQueue() if waiting is None else waiting
        self._answers = ThreadPoolExecutor(1, thread_name_prefix="answers")
        self._queryable = session.declare_queryable(keys.command("*"), self._take, complete=True)
        self._token = session.liveliness().declare_token(keys.alive)

    def next(self, timeout: float | None = None) -> Command | None:
        """As ``CommandQueue.next``."""
        return self._waiting.next(timeout)

    def close(self) -> None:
        """Takes back token and queryable; commands still waiting are refused."""
        self._token.undeclare()
        self._queryable.undeclare()
        self._waiting.close()
        self._answers.shutdown()

    def _take(self, query: zenoh.Query) -> None:
        """Called on one of Zenoh's threads; a payload that is too long is refused at once, to free its memory."""
        command = Command(query, self._answers)
        try:
            command.check()
        except InputError as error:
            command.refuse(error)
        else:
            self._waiting.put(command)
