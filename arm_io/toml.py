"""TOML files checked by a pydantic model, with errors that a person can act on."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from arm_io.entries import KINDS, hint
from arm_io.errors import InputError
from arm_io.files import read_text
from arm_io.plain_data import DEEPEST, check_plain
from arm_io.results import write_text

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

M = TypeVar("M", bound="BaseModel")
UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""Pydantic's complaints of an entry that the model does not have."""


def read_toml(path: str | Path) -> dict[str, Any]:
    """The table in a TOML file.

    Raises InputError where it is absent, unreadable, not TOML (with line and column), or not plain.
    """
    return toml_of(read_text(path), path)


def toml_of(text: str, where: str | Path) -> dict[str, Any]:
    """The table that a TOML text says, plain (``check_plain``); InputError naming ``where`` it came from otherwise."""
    import tomllib

    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise InputError(where, f"not valid TOML: is nested more than {DEEPEST} deep") from None
    except ValueError as error:  # tomllib's own, or of a number that Python refuses to read
        raise InputError(where, f"not valid TOML: {error}") from None
    check_plain(where, table)
    return table


def check_kind(path: str | Path, entry: str) -> None:
    """InputError where a file is at ``path`` that is no TOML file with ``entry`` at its top, which would be replaced.

    ``entry`` is one of ``KINDS``. For ahead of writing a file of that kind; an empty file is no error.
    """
    if not os.path.isfile(path) or not os.path.getsize(path):
        return
    try:
        found = entry in read_toml(path)
    except InputError:
        found = False
    if not found:
        kind = KINDS[entry].removeprefix("a ").removeprefix("an ")
        raise InputError(path, f"exists already and is no {kind}, and only that is replaced; use another name")


def check_table(where: str | Path, table: Mapping[str, Any], model: type[M]) -> M:
    """``table`` as ``model``; InputError naming the first wrong entry (joints and channels as the file counts them).

    Numbers that are not finite are refused whatever the model says of them.
    """
    from pydantic import ValidationError

    check_plain(where, dict(table))
    try:
        return model.model_validate(table)
    except ValidationError as error:
        first = _complaints(error)[0]
        right = hint(table, model, first["loc"], unknown=first["type"] in UNKNOWN)
        raise InputError(where, one_line(error) + right) from None


def one_line(error: ValidationError) -> str:
    """The first complaint of a pydantic error as ``joint[2].mass: input should be greater than 0 (is -1)``.

    Entries of arrays are numbered from 1, as everywhere in armscope. Where more is wrong, the number follows.
    """
    complaints = _complaints(error)
    first = complaints[0]
    place = ""
    for part in first["loc"]:
        place += f"[{part + 1}]" if isinstance(part, int) else ("." if place else "") + str(part)
    message = first["msg"].removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    if first["type"] in UNKNOWN:
        message = "unknown entry"
    elif first["type"] == "missing":
        message = "is missing"
    elif not isinstance(first["input"], dict | list) and first["type"] != "value_error":
        message += f" (is {first['input']!r})"
    more = f" (and {len(complaints) - 1} more)" if len(complaints) > 1 else ""
    return f"{place}: {message}{more}" if place else f"{message}{more}"


def _complaints(error: ValidationError) -> list[Any]:
    """Pydantic's complaints; before a first that an entry is missing, those of unknown ones beside it: misspelt."""
    complaints = error.errors(include_url=False)
    first = complaints[0]
    if first["type"] == "missing":
        beside = first["loc"][:-1]
        complaints.sort(key=lambda one: not (one["type"] in UNKNOWN and one["loc"][:-1] == beside))
    return complaints


def write_toml(path: str | Path, table: Mapping[str, Any], *, heading: str = "") -> None:
    """Writes ``table``, whole or not at all (temporary file, then rename); ``heading`` becomes comment lines on top."""
    import tomli_w

    comment = "".join(f"# {line}".rstrip() + "\n" for line in heading.splitlines())
    write_text(path, comment + ("\n" if comment else "") + tomli_w.dumps(table))
