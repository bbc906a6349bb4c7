"""A disk that takes its time: what a worn card, a network share or a busy machine does to a recorder."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

SYNCS = [name for name in ("fsync", "fdatasync") if hasattr(os, name)]
"""The calls of ``os`` that wait for the disk; POSIX has both, Windows only the first."""


@dataclass
class Waits:
    """Number of delayed calls."""

    count: int = 0


@contextmanager
def slow_disk(seconds: float | Callable[[], float]) -> Iterator[Waits]:
    """While the context lasts, every ``os.fsync`` and ``os.fdatasync`` of this process takes ``seconds`` s longer.

    The data is written all the same. A function is asked at every call; 0: no delay, and none counted.
    """
    waits = Waits()

    def slowed(call: Callable[[Any], None]) -> Callable[[Any], None]:
        def slow(file: Any) -> None:
            delay = seconds() if callable(seconds) else seconds
            if delay > 0:
                time.sleep(delay)
                waits.count += 1
            call(file)

        return slow

    with ExitStack() as patches:
        for name in SYNCS:
            patches.enter_context(patch.object(os, name, slowed(getattr(os, name))))
        yield waits
