"""A process that another one starts, and that must not outlive it, however that one ends.

The starter holds the other end of the standard input. It is closed when the starter ends, also by SIGKILL, on every
system; what was started reads it and ends by itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Annotated, Any

import typer

Attached = Annotated[
    bool, typer.Option("--attached", help="end when standard input is closed, as when the process that started it ends")
]


def start_attached(arguments: list[str], **options: Any) -> subprocess.Popen[str]:
    """An armscope command with ``--attached``, in a session of its own: a Ctrl-C at our terminal is not its."""
    command = [sys.executable, "-m", "armscope", *arguments, "--attached"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, text=True, start_new_session=True, **options)


def when_starter_ends(end: Callable[[], None]) -> None:
    """Calls ``end`` on a thread once standard input is closed."""

    handle = sys.stdin.fileno()

    def wait() -> None:
        # not through sys.stdin, whose lock Python takes when it ends: it would abort while this thread waits in a read
        while os.read(handle, 4096):
            pass
        end()

    threading.Thread(target=wait, name="starter", daemon=True).start()
