"""Tells the service manager (systemd) that the daemon is ready, alive or stopping.

Datagrams of ``NAME=value`` lines to ``$NOTIFY_SOCKET``. Without the variables every call does nothing.

Source: sd_notify(3), sd_watchdog_enabled(3).
"""

from __future__ import annotations

import os
import socket
import time


class Watchdog:
    """READY, STATUS, STOPPING, and WATCHDOG at a third of the interval that ``$WATCHDOG_USEC`` asks for."""

    def __init__(self) -> None:
        self._address = os.environ.get("NOTIFY_SOCKET", "")
        usec = os.environ.get("WATCHDOG_USEC", "")
        ours = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self._interval = int(usec) * 1e-6 / 3 if usec.isdigit() and ours else None
        self._due = 0.0

    @property
    def interval(self) -> float | None:
        """s between two watchdog notifications; None if none are expected."""
        return self._interval

    def ready(self, status: str) -> None:
        """All is open; commands are taken."""
        self._send(f"READY=1\nSTATUS={status}\nMAINPID={os.getpid()}")

    def status(self, text: str) -> None:
        """One line for ``systemctl status``."""
        self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """The end has begun."""
        self._send("STOPPING=1")

    def alive(self) -> None:
        """A sign of life, if one is due; to be called from the loop whose life it is."""
        now = time.monotonic()
        if self._interval is not None and now >= self._due:
            self._due = now + self._interval
            self._send("WATCHDOG=1")

    def _send(self, message: str) -> None:
        if not self._address:
            return
        # '@' stands for the NUL byte of an abstract socket.
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            try:
                sender.sendto(message.encode(), address)
            except OSError:  # the manager went away; that is no reason to stop recording
                self._address = ""
