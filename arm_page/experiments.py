"""The experiments that a page offers: the files of some folders, by names that clients may give."""

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
    """An experiment as its file was read: its text, word for word, and the hash of it."""

    path: Path
    text: str
    experiment: Experiment

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()


class Experiments:
    """``*.toml`` of the folders that hold segments; the first folder wins where two have the same name."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = list(folders)

    def list(self) -> list[dict[str, Any]]:
        """Name and description of each that can be read; broken ones with what is wrong in place of it."""
        return [entry for name, path in sorted(self._files().items()) if (entry := _entry(name, path)) is not None]

    def read(self, name: str) -> Chosen:
        """The experiment of that name, as ``list`` has it. InputError: there is none, or it is wrong."""
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
    """None for a file that is something else: a rig, a model."""
    try:
        table = toml_of(read_text(path), name)
    except InputError as error:
        return {"name": name, "title": name, "description": "", "wrong": error.what}
    if "segment" not in table:
        return None
    title, description = (str(table.get(key, "")) for key in ("name", "description"))
    return {"name": name, "title": title or name, "description": description, "wrong": None}
