"""Rows from the messages of a bag: those of one stamp stand in one row; what makes no row is counted or refused."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import InputError
from daq.recording.messages.bag_messages import columns_of

ROWS = 4096
WAITING = 256
"""Rows that wait for messages of the same stamp on other topics."""
LONGEST_STEP_BACK = 10**9
"""ns; a message that was late is late by less, a clock that was set or a simulation that began anew by more."""
ALTERNATING = 3.0
"""How much larger the steps to the next row are than those to the row after it where two courses alternate. They are
half as large in a motion, and as large in noise."""
PARTIAL = "have only some of the joints, and no other message has their stamp"
SMALLEST_STEP = 1e-3
"""rad or m, the mean step that is more than noise."""

Row = dict[str, float]


@dataclass
class BagRows:
    """The rows of a bag, as its messages come.

    topic    of the joints: its messages are rows
    needed   positions (names of columns) that a row must have; efforts: it must have one of these; none: need not
    stamped  whether the messages have stamps of their own; one of the topic without is left out
    """

    path: Path
    topic: str
    needed: Sequence[str]
    efforts: Sequence[str]
    stamped: bool
    _waiting: dict[int, Row] = field(default_factory=dict)
    _newest: int = 0
    _out: dict[str, int] = field(default_factory=dict)
    _late: int = 0
    _latest_by: int = 0
    _rows: int = 0

    def add(self, stamp: int, name: str, part: Any) -> None:
        """One joint state or point. InputError where the stamps of the topic go back."""
        columns = columns_of(name, part)
        if name == self.topic:
            if self.stamped and stamp == 0:
                return self._leave_out("have no stamp")
            if stamp < self._newest - LONGEST_STEP_BACK:
                raise InputError(
                    self.path,
                    f"the stamps of {name} go back by {(self._newest - stamp) / 1e9:.3f} s, from {self._newest} to "
                    f"{stamp} ns; the clock was set, or a simulation was restarted; --recorded-times uses the times "
                    "of recording instead",
                )
            if stamp < self._newest:
                self._late += 1
                self._latest_by = max(self._latest_by, self._newest - stamp)
            self._newest = max(self._newest, stamp)
            if columns.keys() & self._waiting.get(stamp, {}).keys():
                return self._leave_out("repeat the stamp of another (several publishers, or a coarse clock)")
        self._waiting.setdefault(stamp, {}).update(columns)
        return None

    def full(self) -> Iterator[tuple[list[int], list[Row]]]:
        """The first rows by their stamps, once there are enough that none before them can come."""
        if len(self._waiting) >= ROWS + WAITING:
            yield self._taken(ROWS)

    def rest(self) -> Iterator[tuple[list[int], list[Row]]]:
        """What is left at the end of the bag. InputError where no stamp of the bag has all joints."""
        if self._waiting:
            yield self._taken(len(self._waiting))
        if not self._rows and self._out.get(PARTIAL):
            raise InputError(
                self.path,
                f"no stamp on {self.topic} has all joints: messages with different stamps have some of them each; "
                "record a topic with all joints in one message",
            )

    def notes(self) -> list[str]:
        """What was left out of the bag, and why; and whether its messages are in the order of their stamps."""
        notes = [f"{count} messages of {self.topic} {reason}: left out" for reason, count in self._out.items()]
        if self._late:
            notes.append(
                f"{self._late} messages of {self.topic} have a stamp before that of an earlier message, by up to "
                f"{self._latest_by / 1e6:.3g} ms: rows are in the order of the stamps; if the stamps are less exact "
                "than the times of recording, --recorded-times uses these"
            )
        return notes

    def _taken(self, count: int) -> tuple[list[int], list[Row]]:
        """Stamps and columns of rows; InputError where their positions alternate between two courses."""
        stamps = sorted(self._waiting)[:count]
        rows = {stamp: self._waiting.pop(stamp) for stamp in stamps}
        whole = {stamp: row for stamp, row in rows.items() if row.keys() >= set(self.needed)}
        taken = {stamp: row for stamp, row in whole.items() if not self.efforts or row.keys() & set(self.efforts)}
        partial = sum(1 for row in rows.values() if row.keys() & set(self.needed)) - len(whole)
        if partial:
            self._leave_out(PARTIAL, partial)
        self._rows += len(taken)
        if len(whole) > len(taken):
            self._leave_out("have no efforts", len(whole) - len(taken))
        for column in self.needed:
            self._check_course(column, np.array([row[column] for row in taken.values()], float))
        return list(taken), list(taken.values())

    def _check_course(self, column: str, values: np.ndarray) -> None:
        if len(values) < ROWS // 64:
            return
        next_one, one_after = (float(np.nanmean(np.abs(values[n:] - values[:-n]))) for n in (1, 2))
        if next_one > SMALLEST_STEP and next_one > ALTERNATING * one_after:
            joint = column.rpartition(".")[2]
            raise InputError(
                self.path,
                f"the positions of {joint} on {self.topic} alternate between two courses: two nodes publish there; "
                "record the one that measures",
            )

    def _leave_out(self, reason: str, count: int = 1) -> None:
        self._out[reason] = self._out.get(reason, 0) + count
