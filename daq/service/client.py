"""Asks a running server of a rig (daemon, embedded recording, replay): commands and answers as JSON.

Only ``read`` answers bytes: a piece of a file. Errors are typed: ``{"error": "input", "where": ..., "what": ...}`` or
``{"error": "device", "device": ..., "what": ...}``.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh

COMMANDS = (
    "status",
    "identity",
    "check",
    "arm",
    "start",
    "stop",
    "disarm",
    "zero",
    "reset",
    "recordings",
    "checksum",
    "read",
)
ARM_SECONDS = 600.0
"""How long to wait for ``arm``: a robot may have to drive to its start first. A daemon that ends is noticed at once."""
MOST_CHARACTERS = 500
"""Of an error on the wire."""
Table = dict[str, Any]


def call(
    session: zenoh.Session, keys: Keys, verb: str, arguments: Table | None = None, *, timeout: float = 10.0
) -> Table:
    """Runs a command at the server and returns its answer.

    InputError: the server refuses (and says why). DeviceFault: a device failed there, or none answers within
    ``timeout`` s.
    """
    answer = call_for_bytes(session, keys, verb, arguments, timeout=timeout)
    table = json.loads(answer)
    if not isinstance(table, dict):
        raise DeviceFault("daemon", f"answered {answer[:40]!r}, no JSON object")
    return table


def call_for_bytes(session: zenoh.Session, keys: Keys, verb: str, arguments: Table | None, *, timeout: float) -> bytes:
    """As ``call``, errors too, for a command whose answer is no JSON."""
    import zenoh

    replies = session.get(
        keys.command(verb),
        payload=json.dumps(arguments or {}),
        encoding="application/json",
        priority=zenoh.Priority.INTERACTIVE_HIGH if verb != "read" else zenoh.Priority.DATA_LOW,
        congestion_control=zenoh.CongestionControl.BLOCK,
        express=True,
        timeout=timeout,
    )
    for reply in replies:
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
        if reply.err is not None:
            raise error_of(reply.err.payload.to_bytes())
    raise DeviceFault("daemon", f"no answer to '{verb}' for rig '{keys.name}'")


@contextmanager
def claim(session: zenoh.Session, keys: Keys) -> Iterator[str]:
    """A name for this client, to be given to ``arm`` as the argument ``client``.

    A rig that this client has armed is disarmed when the block or the process ends.
    """
    name = uuid.uuid4().hex
    token = session.liveliness().declare_token(keys.client(name))
    try:
        yield name
    finally:
        token.undeclare()


def alive(session: zenoh.Session, keys: Keys) -> bool:
    """Whether a server of this rig is there."""
    return any(reply.ok is not None for reply in session.liveliness().get(keys.alive, timeout=2.0))


def table_of(error: InputError | DeviceFault) -> Table:
    """An error as the wire has it."""
    what = error.what if len(error.what) <= MOST_CHARACTERS else error.what[: MOST_CHARACTERS - 3] + "..."
    if isinstance(error, InputError):
        return {"error": "input", "where": error.where[:MOST_CHARACTERS], "what": what}
    return {"error": "device", "device": error.device, "what": what}


def error_of(payload: bytes) -> InputError | DeviceFault:
    """The error that the server sent; a Zenoh error (time-out) is a fault of the daemon."""
    try:
        table = json.loads(payload)
        if table["error"] == "input":
            return InputError(table["where"], table["what"])
        return DeviceFault(table["device"], table["what"])
    except (ValueError, KeyError, TypeError):
        return DeviceFault("daemon", f"does not answer: {payload.decode(errors='replace').lower()}")
