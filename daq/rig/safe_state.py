"""The safe state of a rig: the arm stopped, every output safe. A device that hangs keeps no other device from its own.

Each command has a thread of its own, because a driver may wait for its device without a time limit.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

CONFIRMED = 5.0
"""s within which a device must have taken the command; a T7 needs one time limit per output at worst."""


def bring_to_safe_state(
    stop: Mapping[str, Callable[[], None]], outputs: Mapping[str, Callable[[], None]], patience: float
) -> list[str]:
    """Stops the arm, then makes all outputs safe at the same time; never raises.

    stop, outputs  device -> the call that stops it, that makes its outputs safe
    patience       s for which the outputs wait for the arm to be stopped
    Returns the devices that failed, or did not take the command within ``CONFIRMED`` s.
    """
    begun = time.monotonic()
    commands = {name: _Command(call) for name, call in stop.items()}
    for command in commands.values():
        command.taken_by(begun + patience)
    safe = {name: _Command(call) for name, call in outputs.items()}
    end = time.monotonic() + CONFIRMED
    return [name for name, command in (*commands.items(), *safe.items()) if not command.taken_by(end)]


class _Command:
    """A call in a thread of its own."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call, self._failed, self._over = call, False, threading.Event()
        try:
            threading.Thread(target=self._run, name="safe state", daemon=True).start()
        except RuntimeError:  # no thread available: one after the other
            self._run()

    def _run(self) -> None:
        try:
            self._call()
        except Exception:  # one device may have failed, and the others must still be made safe
            self._failed = True
        finally:
            self._over.set()

    def taken_by(self, end: float) -> bool:
        """Whether it was over without an error by ``end`` s (time.monotonic); waits as long."""
        return self._over.wait(max(end - time.monotonic(), 0.0)) and not self._failed
