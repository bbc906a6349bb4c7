"""What would be right where an entry of a TOML file is unknown, or the file is of another kind."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, get_args

KINDS = {
    "device": "a rig file",
    "units": "a model file",
    "segment": "an experiment file",
    "columns": "a mapping of columns",
}
"""An entry that files of one kind alone have at their top."""
MOST = 12
"""Names that a line lists."""


def hint(table: Mapping[str, Any], model: type, place: Sequence[int | str], *, unknown: bool) -> str:
    """``; is it mass?``, ``; this looks like a rig file``, or the entries that may be there; empty where none help.

    table    as the file has it
    model    that it should be: a class whose fields pydantic checks
    place    of the entry that is wrong
    unknown  whether that entry should not be there at all
    """
    if other := other_kind(table, _fields(model)):
        return f"; {other}"
    if not unknown:
        return ""
    known = sorted(_entries(model, place[:-1]))
    if close := difflib.get_close_matches(str(place[-1]), known, 1, 0.6):
        return f"; is it {close[0]}?"
    return f"; known are {', '.join(known)}" if 0 < len(known) <= MOST else ""


def other_kind(table: Mapping[str, Any], known: Collection[str]) -> str:
    """``this looks like a rig file``, of a table with an entry that is not ``known``; that it is empty; or nothing."""
    if not table:
        return "the file is empty"
    kinds = [kind for entry, kind in KINDS.items() if entry in table and entry not in known]
    return f"this looks like {kinds[0]}" if kinds else ""


def _entries(model: type, place: Sequence[int | str]) -> Collection[str]:
    """Names of the entries that may stand at a place; of a union, those of all its members."""
    models = [model]
    for part in place:
        fields = [_fields(one)[part] for one in models if part in _fields(one)]
        if fields:
            models = [found for field in fields for found in _models_in(field.annotation)]
        elif isinstance(part, str) and len(models) > 1:
            # the member of a union that pydantic chose, by its tag
            models = [one for one in models if _has_tag(one, part)] or models
    return {field.alias or name for one in models for name, field in _fields(one).items()}


def _fields(model: type) -> Mapping[Any, Any]:
    """Of a pydantic model or dataclass; none of any other class."""
    found: Mapping[Any, Any] = getattr(model, "__pydantic_fields__", {})
    return found


def _has_tag(model: type, tag: str) -> bool:
    return any(tag in get_args(field.annotation) for field in _fields(model).values())


def _models_in(annotation: Any) -> Iterator[type]:
    if _fields(annotation):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)
