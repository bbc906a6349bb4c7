"""For how long the machine kept tasks waiting: what excuses a test in real time from its first result."""

from __future__ import annotations

import os
from pathlib import Path

LONG = 0.02  # s; instruments of the tests wait for 10 ms and more
PRESSURE, STATISTICS = Path("/proc/pressure/cpu"), Path("/proc/stat")


def waited() -> float:
    """s since the start in which a task waited for a core, or the machine itself for its host; 0 where none tells.

    Linux, Documentation/accounting/psi.rst and filesystems/proc.rst (``steal``).
    """
    try:
        some = float(PRESSURE.read_text().split("total=")[1].split()[0]) * 1e-6
    except (OSError, IndexError):
        some = 0.0
    try:
        stolen = int(STATISTICS.read_text().split()[8]) / os.sysconf("SC_CLK_TCK")
    except OSError:
        stolen = 0.0
    return some + stolen


class Pauses:
    """What tasks have waited since ``start``."""

    def __init__(self) -> None:
        self._before = 0.0

    def start(self) -> None:
        self._before = waited()

    def long(self) -> bool:
        return waited() - self._before > LONG
