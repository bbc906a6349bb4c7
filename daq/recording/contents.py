"""The contents of a recording's file as a walk through it finds them: rows by column, attachments, and what is broken."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Channel, Metadata
from numpy.typing import NDArray

from arm_io import InputError
from daq.acquisition.ledger import LedgerSummary, Loss, LossReason
from daq.recording.losses import UNSURE
from daq.recording.mcap_file import walk as mcap_walk
from daq.recording.mcap_file.checksums import MAGIC
from daq.recording.mcap_file.checksums import NAME as CHECKSUMS
from daq.recording.mcap_file.pages import mapped
from daq.recording.mcap_file.writer import PROGRESS, Progress
from daq.recording.messages.row_format import Layout, RowFormat, format_of
from daq.recording.missing_rows import Found, account
from daq.recording.thinned import Thinned


@dataclass
class Contents:
    """What was found.

    form         of the rows; None only while nothing has been found
    columns      column -> its piece of each chunk
    torn         of each chunk: something unreadable stands before it
    attachments  intact ones, by file name
    progress     of the recorder when it wrote last; None where that cannot be read
    most_numbers rows times joints to be kept of each signal; None: all
    thinned      where there are ``most_numbers``: the rows, averaged; ``columns`` then has their numbers alone
    damages      what cannot be read, without the record that a crash cut in two
    cut          that record
    finished     the file has its end
    """

    form: RowFormat | None = None
    columns: dict[str, list[NDArray]] = field(default_factory=dict)
    torn: list[bool] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    progress: Progress | None = None
    most_numbers: int | None = None
    thinned: Thinned | None = None
    damages: list[mcap_walk.Damage] = field(default_factory=list)
    cut: mcap_walk.Damage | None = None
    finished: bool = False

    @property
    def layout(self) -> Layout:
        assert self.form is not None
        return self.form.layout

    def add_rows(self, part: mcap_walk.Rows, *, torn: bool) -> bool:
        """Takes the rows of a chunk, if they have the columns of those before them."""
        if not self.columns:
            self.form = part.form  # what a chunk's checksum confirms is surer than the head
            self.columns = {name: [] for name in _columns(part.form, part.rows)}
        if part.form.layout != self.layout:
            self.damages.append(mcap_walk.Damage(0, 0, "a chunk has other columns than those before it"))
            return False
        columns = _columns(part.form, part.rows)
        if self.most_numbers is not None:
            self.thinned = self.thinned or Thinned(self.most_numbers // max(len(self.layout.joints), 1))
            self.thinned.append(columns)
            columns = {"number": columns["number"]}
        for name, column in columns.items():
            self.columns[name].append(column.copy())
        self.torn.append(torn)
        return True

    def arrays(self) -> dict[str, NDArray]:
        """Column -> (n, ...) array."""
        assert self.form is not None
        if self.thinned is not None:
            return self.thinned.arrays()
        nothing = _columns(self.form, np.empty(0, self.form.dtype))
        pieces = self.columns or {name: [column] for name, column in nothing.items()}
        return {name: np.concatenate(column) for name, column in pieces.items()}

    def ledger(self) -> tuple[LedgerSummary, bool]:
        """The ledger, and whether it is sure that nothing more is missing."""
        lengths = [len(piece) for piece in self.columns.get("number", [])]
        torn = np.zeros(sum(lengths), bool)
        torn[np.cumsum([0, *lengths[:-1]])[: len(self.torn)]] = self.torn
        numbers = np.concatenate([np.empty(0, np.int64), *self.columns.get("number", [])])
        return account(Found(numbers, torn, self.finished), self._written_ledger(), self.progress)

    def notes(self, sure: bool) -> tuple[str, ...]:
        """Sentences about what is wrong with the file."""
        notes = [damage.sentence for damage in self.damages]
        if not self.finished:
            what = (
                "its ledger is there, its summary is cut off or damaged"
                if "ledger.json" in self.attachments
                else "it was cut off"
            )
            notes.append(f"the file is not finished: {what}")
        if not sure:
            notes.append(UNSURE)
        return tuple(notes)

    def _written_ledger(self) -> LedgerSummary | None:
        data = self.attachments.get("ledger.json")
        if data is None:
            return None
        table = json.loads(data)
        losses = (
            Loss(loss["first"], loss["rows"], LossReason(loss["reason"]), loss["detail"]) for loss in table["losses"]
        )
        return LedgerSummary(table["triggers"], table["latched"], table["recorded"], tuple(losses))


def read_contents(path: Path, *, most_numbers: int | None = None) -> Contents:
    """Walks the file. InputError where it is absent, or no row and no layout of ours can be found in it.

    most_numbers  rows times joints to be kept of each signal (``daq.recording.thinned``); None: all
    """
    data = mapped(path)
    contents, torn = Contents(most_numbers=most_numbers), False
    for part in mcap_walk.walk(data):
        match part:
            case mcap_walk.Rows():
                if contents.add_rows(part, torn=torn):
                    torn = False
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
        magic = data[: len(MAGIC)] == MAGIC
        kind = "is no recording of armscope, or broken beyond repair" if magic else "is not an MCAP file"
        raise InputError(path, f"{kind}; 'armscope import' takes tables")
    if not contents.finished and contents.damages and contents.damages[-1].end == len(data):
        contents.cut = contents.damages.pop()
    return contents


def _columns(form: RowFormat, rows: NDArray[np.void]) -> dict[str, NDArray]:
    """The columns of some rows, as views."""
    columns = {name: rows[name] for name in form.columns}
    return columns | {"wall_ns": rows["times1"][:, 0].astype(np.int64)}


def _layout(text: str) -> RowFormat | None:
    try:
        return format_of(text)
    except ValueError:
        return None
