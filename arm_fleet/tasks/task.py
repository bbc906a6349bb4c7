"""A task of a fleet: what is computed from what, its name by content, and what came of it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

KEY_DIGITS = 40
"""Hexadecimal digits of a key: 160 bits of SHA-256."""


class State(StrEnum):
    """What came of a task. Only the first is a result; the others say why there is none."""

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
"""Failures that a higher limit may avoid."""
PASSING = (State.STORAGE, State.KILLED, State.REFUSED, State.BEFORE)
"""Failures that say nothing of the recordings: the next run of the plan tries again."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One call, in a process of its own, of a function that every worker can import.

    arm, night  what the task is about; night: "2026-01-31", or "" for the baseline of an arm
    call        "module:function", called with (arguments, folder, files of ``after``); writes files into the folder and
                returns a table of plain data
    arguments   plain data that the result depends on
    places      plain data that it does not depend on: where recordings are, by their content in ``arguments``
    code        ``version.code_version`` of whoever plans; a worker with another one refuses
    after       key of the task whose files this one needs
    timeout     s; memory: bytes of data that the process may have
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
        """By content: the same recordings, model, options and code have the same key, wherever the files are."""
        content = [self.call, self.arguments, self.code, self.after]
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:KEY_DIGITS]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def name(self) -> str:
        """For people: 'cell-17 of 2026-01-31'."""
        return f"{self.arm} of {self.night}" if self.night else f"baseline of {self.arm}"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a task.

    reason   one sentence, "" of a result
    value    what the function returned; files: name -> content of what it wrote
    seconds  that the process ran; cpu: s of its processor time; peak: bytes of its resident memory at most
    worker   address and host that ran it
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
