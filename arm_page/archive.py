"""The archive of the page's recordings and results: the same index and filters as ``armscope archive``."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from arm_archive import Archive, Filters, open_archive
from arm_io import InputError
from arm_page.recordings import Recordings

Table = dict[str, Any]
MOST_ROWS = 1000
"""Maximum number of newest entries sent to a browser; the filters find the others."""
MOST_TICKETS = 200
MOST_PICTURES = 50


class FolderArchive:
    """Archive of the folder to which the daemon records, and of its subfolders; every answer reads the index again."""

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._tickets: dict[str, Path] = {}
        self._drawing = threading.Lock()

    def rows(self, query: Mapping[str, str]) -> Table:
        """Entries that meet the filters, the newest first, and the names of all parameters.

        InputError for an unknown filter or an invalid value.
        """
        filters = filters_of(query)
        with self._opened() as archive:
            found = archive.rows(filters)[::-1]
            return {
                "folder": str(archive.folder),
                "entries": len(archive),
                "found": len(found),
                "rows": found[:MOST_ROWS],
                "parameters": archive.parameters(),
                "notes": archive.notes,
            }

    def history(self, parameter: str, query: Mapping[str, str]) -> list[Table]:
        """Every value of a parameter by date, with its standard deviation; InputError if no result has it."""
        filters = filters_of(query)
        with self._opened() as archive:
            return archive.history(parameter, filters)

    def entry(self, path: str) -> Table:
        """One entry, its parameters, the results made from it, and an address for each report.

        InputError: there is no entry of that path.
        """
        with self._opened() as archive:
            row = next((row for row in archive.rows() if row["path"] == path), None)
            if row is None:
                raise InputError(path, "is not in the archive; reload the list")
            made = archive.used_in(row) if row["kind"] == "recording" else []
            reports = [
                {
                    "path": one["path"],
                    "kind": one["kind"],
                    "verdict": one["verdict"],
                    "report": self._ticket(one["report"]),
                }
                for one in (row, *made)
                if one["report"]
            ]
            return {"entry": row, "parameters": archive.parameters(path), "reports": reports}

    def pictures(self, paths: Sequence[str], *, draw: bool) -> Table:
        """Small SVG pictures of entries, as many as can be drawn in half a second, one request at a time.

        ``draw`` False (during a run): only pictures that are stored already, and ``later`` is true.
        """
        if len(paths) > MOST_PICTURES:
            raise InputError("path", f"may be given {MOST_PICTURES} times at most")
        with self._drawing, self._opened() as archive:
            return {"pictures": archive.pictures(paths, seconds=0.5, draw=draw), "later": not draw}

    def report(self, ticket: str) -> Path:
        """Path of a report. InputError: there is no report of that name."""
        path = self._tickets.get(ticket)
        if path is None or not path.is_file():
            raise InputError("report", "there is none of that name")
        return path

    def _ticket(self, name: str) -> str | None:
        """An unguessable address of a report, because a frame sends no token. None: no such file in the folder."""
        folder = self._recordings.folder.resolve()
        path = (folder / name).resolve()
        if not path.is_relative_to(folder) or not path.is_file():
            return None
        known = next((ticket for ticket, other in self._tickets.items() if other == path), None)
        ticket = known or secrets.token_urlsafe(18)
        self._tickets[ticket] = path
        for old in list(self._tickets)[:-MOST_TICKETS]:
            del self._tickets[old]
        return f"/reports/{ticket}"

    def _opened(self) -> Archive:
        return open_archive(self._recordings.folder)


def filters_of(query: Mapping[str, str]) -> Filters:
    """Filters from the query of a request; empty values count as none."""
    given = {name: value for name, value in query.items() if value.strip()}
    known = {field.name for field in fields(Filters)}
    for name in given:
        if name not in known:
            raise InputError(name, f"is no filter; there are {', '.join(sorted(known))}")
    lost = given.pop("lost", None)
    if lost is not None and not (lost.strip().isascii() and lost.strip().isdigit()):
        raise InputError("--lost", f"must be a number of rows, 0 or more (is {lost!r})")
    return Filters(**given, lost=None if lost is None else int(lost))
