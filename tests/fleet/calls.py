"""What the tasks of the tests do: small functions that misbehave on demand."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm_fleet import Task, code_version
from arm_fleet.storage import StorageError
from arm_io import InputError
from arm_io.parallel import cores, in_parallel

HERE = "tests.fleet.calls"


def task(name: str, call: str = "square", *, timeout: float = 60.0, memory: int = 10**9, **arguments: Any) -> Task:
    """A task of arm ``name`` that calls a function of this module."""
    after = arguments.pop("after", None)
    code = arguments.pop("code", code_version())
    return Task(
        arm=name,
        night=arguments.pop("night", "2026-01-01"),
        call=f"{HERE}:{call}",
        arguments={"name": name, **arguments},
        code=code,
        after=after,
        timeout=timeout,
        memory=memory,
    )


def processes(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    """How many cores a task uses, and how many processes."""
    return {"cores": cores(), "processes": len(set(in_parallel(lambda _: os.getpid(), range(4))))}


def square(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    """The square of x, also in a file; marks in ``job["log"]`` that it ran."""
    if "log" in job:
        with open(job["log"], "a") as log:
            log.write(f"{job['name']}\n")
    time.sleep(job.get("seconds", 0.0))
    result = job.get("x", 0) ** 2 + int(before.get("square.txt", b"0"))
    (folder / "square.txt").write_text(str(result))
    (folder / "filling.bin").write_bytes(bytes(job.get("size", 0)))
    return {"square": result}


def endless(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    """Ignores what asks it to stop."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    (Path(job["pid"]) if "pid" in job else folder / "pid").write_text(str(os.getpid()))
    while True:
        time.sleep(0.01)


def greedy(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    """Eats memory until it is refused."""
    eaten = []
    while True:
        eaten.append(bytearray(50_000_000))


def unusable(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    raise InputError("a.mcap", "is damaged; record it again")


def unreached(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    raise StorageError("s3://lab/a.mcap", "cannot be read: Connect timeout")


def broken(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    return {"ratio": 1 // job.get("x", 0)}


def suicidal(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    os.kill(os.getpid(), signal.SIGKILL)
    return {}
