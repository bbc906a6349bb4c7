"""Rescues what an unfinished or damaged recording holds into a finished one, and says what is missing."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from arm_io import DeviceFault, InputError, check_file
from daq.acquisition.ledger import LedgerSummary
from daq.recording.contents import Columns, Contents, read_contents
from daq.recording.losses import Account, opened
from daq.recording.mcap_file import walk as mcap_walk
from daq.recording.mcap_file.checksums import NAME as CHECKSUMS
from daq.recording.mcap_file.checksums import verify
from daq.recording.mcap_file.pages import ACTIVE
from daq.recording.mcap_file.writer import McapFile, as_json, being_written
from daq.recording.messages.row_format import format_of
from daq.recording.parts import finish_file, open_file, write_content, write_pictures
from daq.recording.provenance import check_ending, check_replaceable


@dataclass(frozen=True)
class Recovery:
    """What was rescued.

    ledger       of the new file
    sure         that no more rows are missing
    notes        what was wrong with the old file
    attachments  how many of them are lost
    """

    path: Path
    ledger: LedgerSummary
    sure: bool
    notes: tuple[str, ...]
    attachments: int

    @property
    def complete(self) -> bool:
        """Nothing is missing; other damaged parts (indexes, schemas, the summary) were rewritten."""
        return self.sure and not self.ledger.lost and not self.attachments


def recover(path: str | Path, out: str | Path | None, *, replace: bool = False) -> Recovery:
    """Copies every intact row and attachment of ``path`` into the new recording ``out``, byte for byte.

    out      default: ``path`` without '.active'
    replace  an existing recording ``out``
    Raises InputError where nothing can be read, or ``out`` exists; DeviceFault where the disk refuses.
    """
    path = Path(path)
    out = _place(path, out, replace)
    contents, _ = read_contents(path, lambda layout: _NoRows())
    if being_written(path):
        raise InputError(path, "is being recorded right now; wait until it is finished")
    ledger, sure = contents.ledger()
    damages = verify(contents.data).damages
    notes = (*contents.notes(sure), *(damage.sentence for damage in damages))
    file = open_file(out, format_of(contents.layout.to_json()), {}, replace=replace, viewers=contents.pictures)
    try:
        _copy(contents, file)
        report = {"from": path.name, "at": datetime.now(UTC).isoformat(timespec="seconds"), "notes": notes}
        file.attach("recovery.json", "application/json", as_json(report))
        if contents.progress is not None:
            file.progress(contents.progress)
        finish_file(file, ledger)
    except OSError as error:
        file.abandon()
        raise DeviceFault("disk", f"{error.strerror} while writing {out}; {path} is as it was") from None
    except BaseException:
        file.abandon()
        raise
    opened(Account(path, ledger, notes))
    lost = sum(damage.opcode == Opcode.ATTACHMENT and CHECKSUMS not in damage.name for damage in damages)
    return Recovery(out, ledger, sure, notes, lost)


def _place(path: Path, out: str | Path | None, replace: bool) -> Path:
    """Where the new recording goes; InputError where it may not."""
    if out is None:
        if path.suffix != ACTIVE:
            raise InputError(path, "is not called '.active'; use --out with the name of the new file")
        out = path.with_suffix("")
    elif not os.path.exists(out):
        check_ending(out)
    check_file(out)
    out = Path(out)
    if out.exists() and os.path.exists(path) and out.samefile(path):
        raise InputError(out, "is the damaged file itself; use another name")
    if replace:
        check_replaceable(out, measured=True)
    return out


def _copy(contents: Contents, file: McapFile) -> None:
    """Intact attachments, pictures and rows, but for what is made anew."""
    for part in mcap_walk.walk(contents.data):
        match part:
            case mcap_walk.File() if part.name not in ("ledger.json", "recovery.json", CHECKSUMS):
                file.attach(part.name, part.media_type, part.data)
            case mcap_walk.Pictures():
                write_pictures(file, part.content)
            case mcap_walk.Rows() if part.form.layout == contents.layout:
                write_content(file, part.form, part.content, part.rows["times1"][:, 0].astype(np.int64))


class _NoRows:
    """The first time that the file is read, no row is kept."""

    def append(self, columns: Columns) -> None: ...
