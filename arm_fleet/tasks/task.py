"""A task of a fleet: function, arguments, name by content, and outcome."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

KEY_DIGITS = 40
"""Hexadecimal digits of a key: 160 bits of SHA-256."""


class State(StrEnum):
    """State of a finished task. Only the first one is a result; the others state why there is none."""

    DONE = "done"
    INPUT = "unusable input"
    STORAGE = "storage not reached"
    TIME = "timeout"
    MEMORY = "out of memory"
    KILLED = "killed"
    BUG = "exception"
    BEFORE = "needs a failed task"
    REFUSED = "refused"


BY_LIMIT = (State.TIME, State.MEMORY)
"""Failures that a higher limit could avoid."""
PASSING = (State.STORAGE, State.KILLED, State.REFUSED, State.BEFORE)
"""Failures that are independent of the recordings: the next run of the plan tries again."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One call of a function that every worker can import, in a separate process.

    arm, night  arm and night of the task; night: "2026-01-31", or "" for the baseline of an arm
    call        "module:function", called with (arguments, folder, files of ``after``); writes files into the folder and
                returns a table of plain data
    arguments   plain data on which the result depends
    places      plain data on which it does not depend: locations of the recordings, by their content in ``arguments``
    code        ``version.code_version`` of the planning process; a worker with another version refuses
    after       key of the task on whose files this one depends
    timeout     s, at most; memory: bytes of data of the process, at most
    """

    arm: str
    night: str
    call: str
    arguments: dict[str, Any]
    places: dict[str, Any] = field(default_factory=dict)
    code: str
    after: str | None = None
    timeout: float
    memory: int

    @property
    def key(self) -> str:
        """Key by content: the same recordings, model, options and code have the same key, wherever the files are."""
        content = [self.call, self.arguments, self.code, self.after]
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:KEY_DIGITS]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def name(self) -> str:
        """Name for messages: 'cell-17 of 2026-01-31'."""
        return f"{self.arm} of {self.night}" if self.night else f"baseline of {self.arm}"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of a task.

    reason   one sentence; "" for a result
    value    return value of the function; files: name -> content of the files that it wrote
    seconds  duration of the process, s; cpu: s of processor time; peak: maximum bytes of resident memory
    worker   address and host of the worker that ran it
    """

    state: State
    reason: str = ""
    value: dict[str, Any] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    seconds: float = 0.0
    cpu: float = 0.0
    peak: int = 0
    worker: str = ""

    @property
    def done(self) -> bool:
        return self.state is State.DONE
