"""Asks a running server of a rig (daemon, embedded recording, replay): commands as JSON, answers and errors as JSON.

Errors are typed: ``{"error": "input", "where": ..., "what": ...}`` or ``{"error": "device", "device": ..., "what": ...}``.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh

COMMANDS = ("status", "identity", "arm", "start", "stop", "zero", "reset")
Table = dict[str, Any]


def call(
    session: zenoh.Session, keys: Keys, verb: str, arguments: Table | None = None, *, timeout: float = 10.0
) -> Table:
    """Runs a command at the server and returns its answer.

    InputError: the server refuses (and says why). DeviceFault: a device failed there, or nobody answers within ``timeout`` s.
    """
    import zenoh

    replies = session.get(
        keys.command(verb),
        payload=json.dumps(arguments or {}),
        encoding="application/json",
        priority=zenoh.Priority.INTERACTIVE_HIGH,
        congestion_control=zenoh.CongestionControl.BLOCK,
        express=True,
        timeout=timeout,
    )
    for reply in replies:
        if reply.ok is not None:
            return _table(reply.ok.payload.to_bytes())
        if reply.err is not None:
            raise error_of(reply.err.payload.to_bytes())
    raise DeviceFault("daemon", f"nobody answered '{verb}' for rig '{keys.name}'")


def alive(session: zenoh.Session, keys: Keys, *, timeout: float = 2.0) -> bool:
    """Whether a server of this rig is there."""
    return any(reply.ok is not None for reply in session.liveliness().get(keys.alive, timeout=timeout))


def table_of(error: InputError | DeviceFault) -> Table:
    """An error as the wire has it."""
    if isinstance(error, InputError):
        return {"error": "input", "where": error.where, "what": error.what}
    return {"error": "device", "device": error.device, "what": error.what}


def error_of(payload: bytes) -> InputError | DeviceFault:
    """The error that the server sent; a Zenoh error (time-out) is a fault of the daemon."""
    try:
        table = json.loads(payload)
        if table["error"] == "input":
            return InputError(table["where"], table["what"])
        return DeviceFault(table["device"], table["what"])
    except (ValueError, KeyError, TypeError):
        return DeviceFault("daemon", f"does not answer: {payload.decode(errors='replace').lower()}")


def _table(payload: bytes) -> Table:
    table = json.loads(payload)
    if not isinstance(table, dict):
        raise DeviceFault("daemon", f"answered {payload[:40]!r}, no JSON object")
    return table
