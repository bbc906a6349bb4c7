"""The experiments that a page offers: files of certain folders, selected by name."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm_io import InputError, read_text, toml_of
from experiment import Experiment, experiment_of


@dataclass(frozen=True)
class Chosen:
    """An experiment as read from its file, with the text of the file and its hash."""

    path: Path
    text: str
    experiment: Experiment

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()


class Experiments:
    """Experiment files ``*.toml`` of the folders; of two with the same name, that of the first folder is taken."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = list(folders)

    def list(self) -> list[dict[str, Any]]:
        """Name and description of each experiment; for an invalid file the error instead of the description."""
        return [entry for name, path in sorted(self._files().items()) if (entry := _entry(name, path)) is not None]

    def read(self, name: str) -> Chosen:
        """The experiment with a name of ``list``. InputError: there is none, or it is invalid."""
        path = self._files().get(name)
        if path is None:
            raise InputError(name, "is no experiment of this page; reload the list")
        text = read_text(path)
        return Chosen(path, text, experiment_of(toml_of(text, name), name))

    def _files(self) -> dict[str, Path]:
        found: dict[str, Path] = {}
        for folder in self._folders:
            if folder.is_dir():
                for path in sorted(folder.glob("*.toml")):
                    found.setdefault(path.name, path)
        return found


def _entry(name: str, path: Path) -> dict[str, Any] | None:
    """Entry of a file; None if it is no experiment, but a rig or a model."""
    try:
        table = toml_of(read_text(path), name)
    except InputError as error:
        return {"name": name, "title": name, "description": "", "wrong": error.what}
    if "segment" not in table:
        return None
    title, description = (str(table.get(key, "")) for key in ("name", "description"))
    return {"name": name, "title": title or name, "description": description, "wrong": None}
