"""An archive: updates its index, and answers queries for entries and for the history of a parameter."""

from __future__ import annotations

import math
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import Any

from arm_archive.entries import COLUMNS, RECORDING, Entry
from arm_archive.filters import Filters, plain
from arm_archive.folder import Found, files_in
from arm_archive.index import Index, index_in_memory, open_index
from arm_archive.pictures import picture_of
from arm_archive.recordings import recording_entry
from arm_archive.results import result_entry
from arm_io import InputError
from arm_report import table

COMMIT = 1.0
"""s between two transactions while files are read: at most this work is lost if the process is killed."""
Row = dict[str, Any]
EVERYTHING = Filters()


@dataclass(frozen=True)
class Update:
    """Result of an update of the index: numbers of files."""

    read: int = 0
    gone: int = 0
    unchanged: int = 0


class Archive:
    """The recordings and results below a folder. Use it as a context manager, or call ``close``.

    folder  as given
    update  result of the update when it was opened
    notes   sentences, if the index could not be written or was made again
    """

    def __init__(self, folder: Path, index: Index, update: Update) -> None:
        self.folder = folder
        self.update = update
        self.notes = index.notes
        self._index = index

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._index.close()

    def __len__(self) -> int:
        return int(self._index.rows("SELECT count(*) AS n FROM entry")[0]["n"])

    def __repr__(self) -> str:
        kinds = self._index.rows("SELECT kind, count(*) AS n FROM entry GROUP BY kind ORDER BY kind")
        inside = ", ".join(f"{one['n']} of kind {one['kind']}" for one in kinds)
        return f"<Archive {self.folder}: {inside or 'empty'}>"

    def _repr_html_(self) -> str:
        rows = self.rows()
        shown = [name for name in COLUMNS if any(row[name] is not None for row in rows)]
        cells = [["" if row[name] is None else str(row[name]) for name in shown] for row in rows]
        return f"<p>{escape(repr(self))}</p>{table(cells, shown)}"

    def rows(self, filters: Filters = EVERYTHING) -> list[Row]:
        """One dictionary per recording or result that meets the filters, sorted by date: ``COLUMNS`` -> value or None.

        The columns are those of ``Entry``; all values are text, numbers or None, as in JSON.
        """
        condition, values = filters.where()
        return self._index.rows(f"SELECT {', '.join(COLUMNS)} FROM entry WHERE {condition} ORDER BY date, path", values)

    def parameters(self, path: str | None = None) -> list[Row]:
        """Name and unit of the parameters of a result (``path`` as in its row); None: of all, with their number."""
        if path is not None:
            query = "SELECT name, value, std, unit FROM parameter WHERE path = ? ORDER BY place"
            return self._index.rows(query, [path])
        return self._index.rows(
            "SELECT name, unit, count(*) AS results FROM parameter GROUP BY name, unit ORDER BY name, unit"
        )

    def history(self, parameter: str, filters: Filters = EVERYTHING) -> list[Row]:
        """Every value of a parameter, sorted by date: path, kind, date, arm, name, value, std (None: not known), unit.

        InputError if no result that meets the filters has it; the message names similar parameters.
        """
        condition, values = filters.where()
        found = self._index.rows(
            "SELECT path, kind, date, arm, name, value, std, unit FROM parameter JOIN entry USING (path) "
            f"WHERE name = ? AND {condition} ORDER BY date, path",
            [parameter, *values],
        )
        if not found:
            names = [one["name"] for one in self.parameters()]
            alike = [name for name in names if plain(parameter) in plain(name)] or names
            hint = f"results here have {', '.join(alike[:8])}{' ...' * (len(alike) > 8)}" if alike else "none has any"
            raise InputError(parameter, f"is a parameter of no such result; {hint}")
        return found

    def pictures(self, paths: Sequence[str], *, seconds: float = math.inf, draw: bool = True) -> dict[str, str | None]:
        """Small SVG pictures of entries, drawn at the first request and stored in the index.

        None: the file has nothing to draw. ``seconds``: s after which no further picture is drawn; missing pictures
        in the answer can be requested again. ``draw`` False: only stored pictures.
        """
        kinds = {row["path"]: row["kind"] for row in self._index.rows("SELECT path, kind FROM entry")}
        until = time.monotonic() + seconds
        answer: dict[str, str | None] = {}
        for path in dict.fromkeys(paths):
            if path not in kinds:
                answer[path] = None
            elif kept := self._index.picture(path):
                (answer[path],) = kept
            elif draw and time.monotonic() < until:
                answer[path] = picture_of(self.folder, path, kinds[path])
                with suppress(sqlite3.DatabaseError):  # the disk is full: it is drawn again
                    self._index.keep_picture(path, answer[path])
        return answer

    def find(self, name: str) -> Row:
        """The one entry of a path, of a folder, or of a part of a path; InputError if there is none, or several."""
        rows = self.rows()
        exact = [row for row in rows if name.rstrip("/") in (row["path"], PurePosixPath(row["path"]).parent.as_posix())]
        found = exact or [row for row in rows if plain(name) in plain(row["path"])]
        if len(found) == 1:
            return found[0]
        paths = ", ".join(row["path"] for row in found[:5]) + (" ..." if len(found) > 5 else "")
        what = f"may be any of {paths}; give more of the path" if found else f"is nothing in {self.folder}"
        raise InputError(name, what)

    def used_in(self, recording: Row) -> list[Row]:
        """The results that were made from a recording, matched by the name of its file."""
        name = Path(recording["path"]).name
        return [row for row in self.rows() if name in (row["made_from"] or "").split(", ")]


def open_archive(
    folder: str | PathLike[str], *, progress: Callable[[int, int, str], None] = lambda done, of, path: None
) -> Archive:
    """Opens the archive of a folder; makes or updates its index: only files that changed are read.

    progress  called with bytes read, bytes to be read, and the path of the next file
    InputError if ``folder`` is no readable folder.
    """
    folder = Path(folder)
    found = list(files_in(folder))
    index = open_index(folder)
    try:
        try:
            update = _refresh(folder, found, index, progress)
        except sqlite3.DatabaseError as error:  # the disk is full, or the file vanished meanwhile
            index.close()
            index = index_in_memory(folder, str(error))
            update = _refresh(folder, found, index, progress)
        return Archive(folder, index, update)
    except BaseException:
        index.close()
        raise


def _refresh(folder: Path, found: list[Found], index: Index, progress: Callable[[int, int, str], None]) -> Update:
    known = index.stamps()
    present = {one.path for one in found}
    gone = [path for path in known if path not in present]
    changed = [one for one in found if known.get(one.path) != one.stamp]
    if gone:
        index.forget(gone)
    for batch in _batches(_read(folder, changed, progress)):
        index.put(batch)
    return Update(read=len(changed), gone=len(gone), unchanged=len(found) - len(changed))


def _read(
    folder: Path, changed: list[Found], progress: Callable[[int, int, str], None]
) -> Iterator[tuple[Found, Entry, int]]:
    done, total = 0, sum(change.size for change in changed)
    for one in changed:
        progress(done, total, one.path)
        began = time.time_ns()
        read = recording_entry if one.kind == RECORDING else result_entry
        yield one, read(folder, one), began
        done += one.size
    progress(done, total, "")


def _batches(read: Iterable[tuple[Found, Entry, int]]) -> Iterator[list[tuple[Found, Entry, int]]]:
    """Batches of entries, each of which takes about ``COMMIT`` s to read."""
    batch: list[tuple[Found, Entry, int]] = []
    since = time.monotonic()
    for one in read:
        batch.append(one)
        if time.monotonic() - since > COMMIT:
            yield batch
            batch, since = [], time.monotonic()
    if batch:
        yield batch
