"""Fleets of the page: results that ``armscope fleet`` wrote into a folder of the recordings, with their pages."""

from __future__ import annotations

import json
import secrets
from pathlib import Path
from typing import Any

from arm_io import InputError, read_text
from arm_page.access import same
from arm_page.recordings import Recordings

Table = dict[str, Any]
PLACES = ("fleet.json", "*/fleet.json", "*/*/fleet.json")
"""Patterns of the results, relative to the folder of the recordings."""
SCHEMA = "armscope.fleet/1"


class Fleets:
    """Results of fleets, searched for at every list; each has an unguessable address, since a frame sends no token."""

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._tickets: dict[Path, str] = {}

    def list(self) -> list[Table]:
        """Name, folder, arms that changed, nights and failed tasks of each, and the address of its page."""
        folder = self._recordings.folder
        found = sorted({path for pattern in PLACES for path in folder.glob(pattern) if path.is_file()})
        return [table for path in found if (table := self._summary(path)) is not None]

    def _summary(self, path: Path) -> Table | None:
        try:
            fleet = json.loads(read_text(path))
            if fleet["schema"] != SCHEMA:
                return None
            counts = {name: int(fleet[name]) for name in ("tasks", "failed", "compared_nights", "named_nights")}
            names = {"name": str(fleet["name"]), "arms": len(fleet["arms"]), "changed": [*map(str, fleet["changed"])]}
        except (InputError, ValueError, KeyError, TypeError):
            return None
        place = path.parent.relative_to(self._recordings.folder).as_posix()
        ticket = self._tickets.setdefault(path.parent.resolve(), secrets.token_urlsafe(18))
        return {"folder": place, **names, **counts, "page": f"/fleets/{ticket}/fleet.html"}

    def file(self, ticket: str, name: str) -> Path:
        """A page of a fleet: main page, page of an arm, or report of a night. InputError: no page of that name."""
        folder = next((one for one, its in self._tickets.items() if same(its, ticket)), None)
        path = None if folder is None else (folder / name).resolve()
        if folder is None or path is None or path.suffix != ".html" or not path.is_relative_to(folder):
            raise InputError("fleet", "there is no page of that name")
        if not path.is_file():
            raise InputError("fleet", "there is no page of that name")
        return path
