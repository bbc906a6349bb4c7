"""The files that armscope brings along: rigs, models, experiments, starter projects, viewer layouts, the systemd unit.

They stand in ``config/`` of the repository; ``setup.py`` installs them as ``armscope/config``.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

NAME = "config"


def shipped_folder() -> Path:
    """``config/``: of the installed package, or of the checkout that this module runs from."""
    package = Path(__file__).resolve().parent
    installed = package / NAME
    return installed if installed.is_dir() else package.parent / NAME


def shipped_file(path: str | PathLike[str]) -> Path | None:
    """The shipped file of a path such as ``config/models/puma560.toml``; None if there is none.

    Only a path that begins with ``config/`` and does not exist in the working directory means a shipped file: a file
    in place always comes first.
    """
    path = Path(path)
    if path.parts[:1] != (NAME,) or ".." in path.parts or path.exists():
        return None
    shipped = shipped_folder().joinpath(*path.parts[1:])
    return shipped if shipped.is_file() else None


def found(path: str | PathLike[str]) -> Path:
    """The path itself, or the shipped file that it means."""
    return shipped_file(path) or Path(path)
