"""One task in a process of its own: whatever it does, the outcome says what came of it, and nothing of it is left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from arm_fleet.tasks.bounded import bounded
from arm_fleet.tasks.task import State
from tests.fleet.calls import task

IN_A_WORKER = "from arm_fleet.tasks.bounded import bounded; from tests.fleet.calls import task; "


def test_a_result_and_its_files() -> None:
    outcome = bounded(task("a", x=3), {"square.txt": b"4"})
    assert outcome.state is State.DONE and outcome.value == {"square": 13}
    assert outcome.files == {"square.txt": b"13", "filling.bin": b""}
    assert outcome.cpu > 0 and outcome.peak > 10**6


def test_a_task_uses_one_core_as_the_others_are_for_other_tasks() -> None:
    outcome = bounded(task("a", "processes"), {})
    assert outcome.value == {"cores": 1, "processes": 1}


@pytest.mark.parametrize(
    ("call", "state", "reason"),
    [
        ("unusable", State.INPUT, "a.mcap: is damaged; record it again"),
        ("unreached", State.STORAGE, "s3://lab/a.mcap: cannot be read: Connect timeout"),
        ("broken", State.BUG, "ZeroDivisionError at calls.py"),
        ("suicidal", State.KILLED, "its process ended by SIGKILL"),
        ("missing", State.BUG, "has no attribute 'missing'"),
    ],
)
def test_a_failure_says_why(call: str, state: State, reason: str) -> None:
    outcome = bounded(task("a", call), {})
    assert outcome.state is state and reason in outcome.reason


@pytest.mark.skipif(sys.platform != "linux", reason="other kernels do not hold RLIMIT_DATA")
def test_memory_is_refused_beyond_the_limit() -> None:
    outcome = bounded(task("a", "greedy", memory=600_000_000), {})
    assert outcome.state is State.MEMORY and outcome.reason == "needs more than 0.6 GB (memory of the plan)"
    assert outcome.peak < 600_000_000


def test_time_ends_also_what_does_not_listen(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    outcome = bounded(task("a", "endless", timeout=2.0, pid=str(pid)), {})
    assert outcome.state is State.TIME and outcome.reason == "took longer than 2 s (timeout of the plan)"
    assert gone(int(pid.read_text()))


def test_a_worker_that_is_killed_takes_its_task_along(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    code = f"{IN_A_WORKER}bounded(task('a', 'endless', pid={str(pid)!r}), {{}})"
    with subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[2]) as worker:
        until = time.monotonic() + 60
        while not (pid.exists() and pid.read_text()) and time.monotonic() < until:
            time.sleep(0.05)
        worker.send_signal(signal.SIGKILL)
    assert gone(int(pid.read_text()))


def gone(pid: int) -> bool:
    """Whether a process has ended within a while."""
    until = time.monotonic() + 30
    while time.monotonic() < until:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        if "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text():
            return True
        time.sleep(0.05)
    return False
