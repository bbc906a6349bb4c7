"""The contents of a recording's file as a walk through it finds them: rows, attachments, and what is broken."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from mcap.records import Channel, Metadata
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.files import open_regular
from daq.acquisition.ledger import LedgerSummary, Loss, LossReason
from daq.recording.losses import UNSURE
from daq.recording.mcap_file import walk as mcap_walk
from daq.recording.mcap_file.checksums import MAGIC
from daq.recording.mcap_file.checksums import NAME as CHECKSUMS
from daq.recording.mcap_file.pages import mapped
from daq.recording.mcap_file.writer import PROGRESS, Progress
from daq.recording.messages.row_format import Layout, RowFormat, format_of
from daq.recording.missing_rows import FoundRows, TriggerRuns, reconciled

Columns = dict[str, NDArray]
"""Column -> (n, ...) of some rows."""


class RowSink(Protocol):
    """Receives the rows of a file while it is read.

    ``append`` is called with one chunk after the other, as views: whoever keeps them copies them.
    """

    def append(self, columns: Columns) -> None: ...


K = TypeVar("K", bound=RowSink)
MOST_TOPICS = 4
"""Of a file of another program that are named."""


class AllRows:
    """Keeps all rows of all columns."""

    factor = 1

    def __init__(self) -> None:
        self._pieces: dict[str, list[NDArray]] = {}

    def append(self, columns: Columns) -> None:
        """The rows that follow."""
        for name, values in columns.items():
            self._pieces.setdefault(name, []).append(values.copy())

    def arrays(self) -> Columns:
        """Column -> (n, ...) array; to be asked once, for the pieces go column by column as the arrays are made."""
        return {name: np.concatenate(self._pieces.pop(name)) for name in list(self._pieces)}


@dataclass
class Contents:
    """What was found.

    data         the file
    form         of the rows; None only while nothing has been found
    numbers      of the triggers of its rows
    attachments  intact ones, by file name
    progress     of the recorder when it wrote last; None where that cannot be read
    damages      what cannot be read, without the record that a crash cut in two
    cut          that record
    finished     the file has its end
    pictures     it has chunks for viewers
    """

    data: memoryview
    form: RowFormat | None = None
    numbers: TriggerRuns = field(default_factory=TriggerRuns)
    attachments: dict[str, bytes] = field(default_factory=dict)
    progress: Progress | None = None
    damages: list[mcap_walk.Damage] = field(default_factory=list)
    cut: mcap_walk.Damage | None = None
    finished: bool = False
    pictures: bool = False

    @property
    def layout(self) -> Layout:
        """What a row holds."""
        assert self.form is not None
        return self.form.layout

    def pieces(self) -> Iterator[Columns]:
        """The rows once more, chunk by chunk."""
        for part in mcap_walk.walk(self.data):
            if isinstance(part, mcap_walk.Rows) and part.form.layout == self.layout:
                yield _columns(part.form, part.rows)

    def nothing(self) -> Columns:
        """No rows, with all columns."""
        assert self.form is not None
        return _columns(self.form, np.empty(0, self.form.dtype))

    def ledger(self) -> tuple[LedgerSummary, bool]:
        """The ledger, and whether it is certain that nothing more is missing."""
        return reconciled(FoundRows(self.numbers.runs(), self.finished), self.written_ledger(), self.progress)

    def notes(self, sure: bool) -> tuple[str, ...]:
        """Sentences about what is wrong with the file."""
        notes = [damage.sentence for damage in self.damages]
        if not self.finished:
            what = (
                "its ledger is complete, its summary is cut off or damaged"
                if "ledger.json" in self.attachments
                else "it was cut off"
            )
            notes.append(f"the file is not finished: {what}")
        if not sure:
            notes.append(UNSURE)
        return tuple(notes)

    def written_ledger(self) -> LedgerSummary | None:
        """The ledger as it stands in the file; None where it is not there."""
        data = self.attachments.get("ledger.json")
        if data is None:
            return None
        table = json.loads(data)
        losses = (
            Loss(loss["first"], loss["rows"], LossReason(loss["reason"]), loss["detail"]) for loss in table["losses"]
        )
        return LedgerSummary(table["triggers"], table["latched"], table["recorded"], tuple(losses))


def _topics(path: Path) -> list[str]:
    """Of the channels in the summary of a file; empty where it has none that can be read."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    try:
        with os.fdopen(open_regular(path), "rb") as file:
            summary = make_reader(file).get_summary()
    except (McapError, ValueError, struct.error, OSError):
        return []
    return sorted({channel.topic for channel in summary.channels.values()}) if summary else []


def _foreign(path: Path, data: memoryview) -> str:
    """A sentence on what a file without armscope's rows is, and what to do with it."""
    if data[: len(MAGIC)] != MAGIC:
        return "is not an MCAP file; 'armscope import' takes tables and ROS 2 bags"
    topics = _topics(path)
    if not topics:
        return "is not a recording of armscope, or damaged beyond repair; 'armscope import' takes tables and ROS 2 bags"
    more = len(topics) - MOST_TOPICS
    listed = ", ".join(topics[:MOST_TOPICS]) + (f" and {more} more" if more > 0 else "")
    return (
        f"is not a recording of armscope but an MCAP file of another program, with {listed}; of a ROS 2 bag "
        "'armscope import FILE --out RUN.mcap' makes a recording"
    )


def read_contents(path: Path, sink: Callable[[Layout], K]) -> tuple[Contents, K]:
    """Walks the file, and hands its rows to what ``sink`` makes.

    InputError where the file is absent, or no row and no layout of ours can be found in it.
    """
    contents, kept, torn = Contents(mapped(path)), None, False
    for part in mcap_walk.walk(contents.data):
        match part:
            case mcap_walk.Rows() if kept is not None and part.form.layout != contents.layout:
                contents.damages.append(mcap_walk.Damage(0, 0, "a chunk has other columns than those before it"))
            case mcap_walk.Rows():
                if kept is None:
                    contents.form = part.form  # unlike the head, it is protected by a checksum
                    kept = sink(contents.layout)
                columns = _columns(part.form, part.rows)
                contents.numbers.append(columns["number"], torn=torn)
                kept.append(columns)
                torn = False
            case mcap_walk.Pictures():
                contents.pictures = True
            case mcap_walk.File() if part.name != CHECKSUMS:
                contents.attachments[part.name] = part.data
            case Metadata() if part.name == PROGRESS:
                contents.progress = Progress.from_metadata(part.metadata)
            case Channel() if contents.form is None and "layout" in part.metadata:
                contents.form = _layout(part.metadata["layout"])
            case mcap_walk.Damage():
                torn = True
                contents.damages.append(part)
            case mcap_walk.End():
                contents.finished = True
    if contents.form is None:
        raise InputError(path, _foreign(path, contents.data))
    if kept is None:
        kept = sink(contents.layout)
        kept.append(contents.nothing())
    if not contents.finished and contents.damages and contents.damages[-1].end == len(contents.data):
        contents.cut = contents.damages.pop()
    return contents, kept


def _columns(form: RowFormat, rows: NDArray[np.void]) -> Columns:
    """The columns of some rows, as views."""
    columns = {name: rows[name] for name in form.columns}
    return columns | {"wall_ns": rows["times1"][:, 0].astype(np.int64)}


def _layout(text: str) -> RowFormat | None:
    try:
        return format_of(text)
    except ValueError:
        return None
