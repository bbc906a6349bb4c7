"""A disk that takes its time: what a worn card, a network share or a busy machine does to a recorder."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from unittest.mock import patch


@dataclass
class Waits:
    """Number of delayed fsyncs."""

    count: int = 0


@contextmanager
def slow_disk(seconds: float) -> Iterator[Waits]:
    """While the context lasts, every ``os.fsync`` of this process takes ``seconds`` s longer.

    The data is written all the same.
    """
    true, waits = os.fsync, Waits()

    def slow(file: int) -> None:
        waits.count += 1
        time.sleep(seconds)
        true(file)

    with patch.object(os, "fsync", slow):
        yield waits
