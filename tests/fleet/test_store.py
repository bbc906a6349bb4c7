"""Results are kept once, whole or not at all; a full disk loses none of those before it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from arm_fleet.tasks.store import RECORD, Store
from arm_fleet.tasks.task import Outcome, State
from arm_io import InputError
from tests.fleet.calls import task

DONE = Outcome(state=State.DONE, value={"square": 9}, files={"a/b.txt": b"text"})


def test_a_result_is_kept_and_not_replaced(tmp_path: Path) -> None:
    store, one = Store(tmp_path), task("a", x=3)
    assert not store.settled(one)
    store.put(one, DONE)
    assert store.settled(one) and store.files(one.key) == {"a/b.txt": b"text"}
    again = store.put(one, Outcome(state=State.TIME, reason="took longer"))
    assert again["state"] == "done" and store.record(one.key)["value"] == {"square": 9}  # type: ignore[index]


def test_the_key_follows_the_content() -> None:
    one = task("a", x=3)
    assert one.key == task("a", x=3, timeout=1.0, memory=5 * 10**9).key
    assert len({one.key, task("a", x=4).key, task("a", x=3, code="other").key, task("a", x=3, after="b").key}) == 4


@pytest.mark.parametrize(
    ("state", "higher", "settled"),
    [
        (State.INPUT, False, True),
        (State.STORAGE, False, False),
        (State.BUG, False, True),
        (State.TIME, False, True),
        (State.TIME, True, False),
        (State.MEMORY, True, False),
        (State.KILLED, False, False),
        (State.BEFORE, False, False),
    ],
)
def test_a_failure_is_tried_again_where_that_may_help(
    tmp_path: Path, state: State, higher: bool, settled: bool
) -> None:
    store = Store(tmp_path)
    store.put(task("a", timeout=5.0, memory=10**9), Outcome(state=state, reason="why"))
    now = task("a", timeout=10.0, memory=2 * 10**9) if higher else task("a", timeout=5.0, memory=10**9)
    assert store.settled(now) is settled
    store.put(now, DONE)
    assert store.settled(now)


@pytest.mark.parametrize("damage", ["half", "gone", "shorter"])
def test_a_damaged_result_is_none(tmp_path: Path, damage: str) -> None:
    store, one = Store(tmp_path), task("a", x=3)
    store.put(one, DONE)
    record, file = store.place(one.key) / RECORD, store.place(one.key) / "a/b.txt"
    if damage == "half":
        record.write_text(record.read_text()[:40])
    elif damage == "gone":
        file.unlink()
    else:
        file.write_bytes(b"t")
    assert store.record(one.key) is None and not store.settled(one)
    store.put(one, DONE)
    assert store.settled(one)


def test_what_a_killed_writer_left_is_removed(tmp_path: Path) -> None:
    part = tmp_path / "results/.key.abc.part"
    part.mkdir(parents=True)
    (part / RECORD).write_text("{")
    assert Store(tmp_path) and part.exists(), "another fleet may be writing it"
    for path in (part / RECORD, part):
        os.utime(path, (time.time() - 4000.0,) * 2)
    assert Store(tmp_path) and not part.exists()


FULL = """
import resource, sys
from pathlib import Path
from arm_fleet.tasks.store import Store
from arm_fleet.tasks.task import Outcome, State
from arm_io import InputError
from tests.fleet.calls import task
store = Store(Path(sys.argv[1]))
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
store.put(task("a"), Outcome(state=State.DONE, files={"small": bytes(10_000)}))
try:
    store.put(task("b"), Outcome(state=State.DONE, files={"large": bytes(100_000)}))
except InputError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
def test_a_disk_that_refuses_leaves_earlier_results(tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout == f"{tmp_path}: results cannot be written: File too large\n"
    store = Store(tmp_path)
    assert store.settled(task("a")) and not store.settled(task("b"))
    assert [path.name for path in store.results.iterdir()] == [task("a").key]


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        Store(tmp_path / "file")
