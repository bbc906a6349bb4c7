"""Work on several cores: equal to that of one, whatever happens to the processes, none of which is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from arm_io import parallel
from arm_io.parallel import CORES, cores, in_parallel

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems work in one process")
SLEEPERS = """
import os, signal, sys, time
from arm_io import parallel
# a shell starts what it puts in the background without
signal.signal(signal.SIGINT, signal.default_int_handler)
parallel.cores = lambda: 3
def work(number):
    os.write(1, b"%d\\n" % os.getpid())
    time.sleep(60)
try:
    parallel.in_parallel(work, list(range(3)))
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.fixture(autouse=True)
def three_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many processes, however many cores the machine has, and beside the threads of those who run the tests."""
    monkeypatch.setattr(parallel, "cores", lambda: 1 if parallel._sharing else 3)
    monkeypatch.setattr(parallel, "_forks_safely", lambda: True)


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_equal_to_the_last_bit_and_in_order(count: int) -> None:
    def work(number: int) -> tuple[int, np.ndarray]:
        time.sleep(0.002 * (number % 3))
        return number, np.random.default_rng(number).standard_normal((200, 300)).T

    for (a, x), (b, y) in zip(in_parallel(work, range(count)), map(work, range(count)), strict=True):
        assert a == b and x.tobytes() == y.tobytes() and x.flags.f_contiguous == y.flags.f_contiguous


def test_what_comes_back_belongs_to_this_process() -> None:
    """Arrays lie in memory that came from another process: a later one that writes there changes its own copy."""
    found = in_parallel(lambda number: [np.full(3 - number % 2, float(number)), np.zeros(0)], range(12))

    def write(number: int) -> float:
        found[number][0][:] = -1.0
        return float(found[number][0].sum())

    assert in_parallel(write, range(12)) == [-3.0 + number % 2 for number in range(12)]
    for number, (values, nothing) in enumerate(found):
        assert nothing.size == 0 and set(values) in ({float(number)}, {-1.0})
        values += 1.0
    # what this process did not write itself is as it was
    in_parallel(write, range(12))


def _all_work(folder: Path) -> None:
    """Returns when three processes have come here."""
    (folder / str(os.getpid())).touch()
    deadline = time.monotonic() + 20
    while len(list(folder.iterdir())) < 3 and time.monotonic() < deadline:
        time.sleep(0.002)


def test_several_processes_work_and_none_of_them_starts_more(tmp_path: Path) -> None:
    def work(number: int) -> tuple[int, list[int], int]:
        _all_work(tmp_path)
        return os.getpid(), in_parallel(lambda _: os.getpid(), range(3)), parallel.cores()

    found = in_parallel(work, range(12))
    assert len({process for process, _, _ in found}) == 3
    assert all(inner == [process] * 3 and alone == 1 for process, inner, alone in found)
    assert parallel.cores() == 3


def test_beside_other_threads_nothing_is_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A notebook has several, and a lock that one of them holds is never released in a fork."""
    monkeypatch.undo()
    monkeypatch.setattr(parallel, "cores", lambda: 3)
    end = threading.Event()
    beside = threading.Thread(target=end.wait, daemon=True)
    beside.start()
    assert set(in_parallel(lambda _: os.getpid(), range(12))) == {os.getpid()}
    end.set()
    beside.join()


def test_the_first_exception_is_raised() -> None:
    before = _children()

    def work(number: int) -> int:
        if number in (7, 3):
            raise ValueError(number)
        return number

    with pytest.raises(ValueError, match="3"):
        in_parallel(work, range(12))
    assert _children() <= before


def test_what_a_killed_process_did_is_done_again(tmp_path: Path) -> None:
    here, before = os.getpid(), _children()

    def work(number: int) -> int:
        _all_work(tmp_path)
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return number**2

    assert in_parallel(work, range(9)) == [number**2 for number in range(9)]
    assert _children() <= before


def test_cores_are_those_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    here = len(os.sched_getaffinity(0))
    for stated, expected in (("1", 1), ("0", 1), ("100", here), ("many", here), ("", here)):
        monkeypatch.setenv(CORES, stated)
        assert cores() == expected


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_its_parent(end: signal.Signals, root: Path) -> None:
    with _sleeping(root) as (process, workers):
        # Ctrl-C reaches all processes of a terminal
        os.killpg(process.pid, end) if end is signal.SIGINT else process.send_signal(end)
        assert process.wait(10) == (130 if end is signal.SIGINT else -end)
        deadline = time.monotonic() + 10
        while any(map(_runs, workers)) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not any(map(_runs, workers))
        assert process.stderr is not None and process.stderr.read() == ""


@contextmanager
def _sleeping(root: Path) -> Iterator[tuple[subprocess.Popen[str], set[int]]]:
    """A process, and those of all three that work for it, in the middle of their work."""
    process = subprocess.Popen(
        [sys.executable, "-c", SLEEPERS],
        env=os.environ | {"PYTHONPATH": str(root)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        workers = {int(process.stdout.readline()) for _ in range(3)}
        assert len(workers) == 3 and all(map(_runs, workers))
        yield process, workers
    finally:
        process.kill()
        process.communicate()


def _runs(process: int) -> bool:
    """Whether a process exists that is no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def _children() -> set[int]:
    """Of this process, zombies too."""
    return set(map(int, Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()))


def test_of_many_cores_no_more_processes_are_used_than_descriptors_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of them holds one while its arrays are used."""
    monkeypatch.setattr(parallel, "cores", lambda: 50)

    def work(number: int) -> int:
        time.sleep(0.01)
        return os.getpid()

    assert 1 < len(set(in_parallel(work, range(100)))) <= 16
