"""Store of results: each is in a folder named by its content, complete or not at all.

    FOLDER/results/KEY/record.json   outcome of the task; its files are in the same folder

A result is written to a temporary folder, synchronised to the disk, and then renamed. A process that is killed leaves
no incomplete result, a full disk keeps the earlier ones, and two processes with the same result leave one.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm_fleet.tasks.task import BY_LIMIT, PASSING, Outcome, State, Task
from arm_io import InputError, check_folder, make_folder, read_file
from arm_io.handles import folder_to_disk, to_disk
from arm_io.plain_data import check_plain
from comparison import in_words

RECORD = "record.json"
SCHEMA = "armscope.fleet.record/1"
Record = dict[str, Any]
ABANDONED = 3600.0
"""s after its last change until an unfinished result is removed; another fleet may be writing it."""
REPORTS = ("diagnosed/report.html", "identified/report.html")
"""Reports of a night; the first one that exists is linked."""


@dataclass(frozen=True, slots=True)
class TaskLine:
    """Summary of a record that a fleet keeps in memory.

    verdict, causes  of the diagnosis, in words; report: path of its page relative to the folder, "" where there is none
    """

    arm: str
    night: str
    key: str
    state: str
    reason: str
    verdict: str = ""
    causes: str = ""
    report: str = ""

    @property
    def done(self) -> bool:
        return self.state == State.DONE


def line_of(record: Record) -> TaskLine:
    """The summary of a record."""
    value, key = record["value"], record["key"]
    causes = ", ".join(in_words((one["effect"], one["joint"])) for one in value.get("causes", []))
    report = next((f"results/{key}/{name}" for name in REPORTS if name in record["files"]), "")
    return TaskLine(
        record["arm"],
        record["night"],
        key,
        record["state"],
        record["reason"],
        value.get("verdict") or "",
        causes,
        report,
    )


class Store:
    """The results below a folder, which is made with the first result. InputError if it cannot be made."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.results = folder / "results"
        check_folder(self.results)
        for part in self.results.glob(".*.part"):
            if _untouched(part) > ABANDONED:
                shutil.rmtree(part, ignore_errors=True)

    def place(self, key: str) -> Path:
        """The folder of a result."""
        return self.results / key

    def record(self, key: str) -> Record | None:
        """Outcome of a task; None if there is none, or if the stored record is incomplete."""
        place = self.place(key)
        try:
            table = json.loads(read_file(place / RECORD))
            check_plain(place / RECORD, table)
            sizes = table["files"]
            whole = table["schema"] == SCHEMA and all((place / name).stat().st_size == sizes[name] for name in sizes)
        except (InputError, ValueError, KeyError, TypeError, OSError):
            return None
        return table if whole else None

    def settled(self, task: Task) -> bool:
        """Whether a task need not run: it has a result, or a failure that would repeat."""
        record = self.record(task.key)
        if record is None or record["state"] in PASSING:
            return False
        if record["state"] not in BY_LIMIT:
            return True
        limit = (record["timeout"], task.timeout) if record["state"] == State.TIME else (record["memory"], task.memory)
        return bool(limit[0] >= limit[1])

    def files(self, key: str) -> dict[str, bytes]:
        """Name -> content of the files of a result."""
        record = self.record(key) or {"files": {}}
        return {name: read_file(self.place(key) / name) for name in record["files"]}

    def put(self, task: Task, outcome: Outcome) -> Record:
        """Stores the outcome of a task; an earlier failure is replaced, an earlier result is not.

        InputError if the disk refuses; then the earlier content remains.
        """
        record = _record(task, outcome)
        place = self.place(task.key)
        make_folder(self.results)
        try:
            part = Path(tempfile.mkdtemp(dir=self.results, prefix=f".{task.key}.", suffix=".part"))
            try:
                for name, content in (outcome.files | {RECORD: _text(record)}).items():
                    _write(part / name, content)
                if place.exists():
                    before = self.record(task.key)
                    if before is not None and before["state"] == State.DONE:
                        return before
                    shutil.rmtree(place)
                os.replace(part, place)
                folder_to_disk(self.results)
            finally:
                shutil.rmtree(part, ignore_errors=True)
        except OSError as error:
            raise InputError(self.folder, f"results cannot be written: {error.strerror or error}") from None
        return record


def _untouched(part: Path) -> float:
    """s since the last change of an unfinished result; 0 if it has been removed or finished meanwhile."""
    try:
        return time.time() - max(path.stat().st_mtime for path in (part, *part.rglob("*")))
    except OSError:
        return 0.0


def _record(task: Task, outcome: Outcome) -> Record:
    return {
        "schema": SCHEMA,
        "key": task.key,
        "arm": task.arm,
        "night": task.night,
        "state": str(outcome.state),
        "reason": outcome.reason,
        "seconds": outcome.seconds,
        "cpu_seconds": outcome.cpu,
        "peak_bytes": outcome.peak,
        "worker": outcome.worker,
        "timeout": task.timeout,
        "memory": task.memory,
        "code": task.code,
        "call": task.call,
        "after": task.after,
        "arguments": _without_texts(task.arguments),
        "places": task.places,
        "value": outcome.value,
        "files": {name: len(content) for name, content in outcome.files.items()},
    }


def _without_texts(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Replaces long texts, such as a model, by their hash."""
    return {
        name: f"sha256 {hashlib.sha256(value.encode()).hexdigest()}"
        if isinstance(value, str) and len(value) > 200
        else value
        for name, value in arguments.items()
    }


def _text(record: Record) -> bytes:
    return (json.dumps(record, indent=1, default=float) + "\n").encode()


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as file:
        file.write(content)
        file.flush()
        to_disk(file.fileno())
