"""One command of armscope as a process of its own: its times and its memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def measured(arguments: Sequence[str | Path]) -> dict[str, float]:
    """Runs ``armscope`` with the arguments: wall_s, cpu_s of all its threads, rss_mb of the largest resident set.

    RuntimeError where the command fails. The operating system counts this process's memory in, until the command has
    begun: a caller imports nothing heavy.
    """
    began = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "armscope", *arguments], cwd=ROOT, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"armscope {' '.join(map(str, arguments))} ended with {process.returncode}")
    return {"wall_s": wall, "cpu_s": usage.ru_utime + usage.ru_stime, "rss_mb": usage.ru_maxrss / 1024}


def longest_over_linear(figures: Mapping[str, float], minutes: Sequence[float]) -> dict[str, float]:
    """Processor time per minute of the longest of the cases minutes_M over that of the shortest; {} of one case."""
    if len(minutes) < 2:
        return {}
    short, long = (figures[f"minutes_{m:g}_cpu_s"] / m for m in (min(minutes), max(minutes)))
    return {"longest_over_linear": long / short}
