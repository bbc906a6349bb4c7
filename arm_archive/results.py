"""One result (identification, diagnosis, calibration, comparison) as an entry of the archive."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from arm_archive.entries import Entry, Parameter
from arm_archive.folder import Found
from arm_io import InputError, read_file, read_text, toml_of
from arm_io.dates import utc_date, utc_date_of
from arm_io.plain_data import check_plain

Table = dict[str, Any]


def result_entry(folder: Path, found: Found) -> Entry:
    """Entry of a result, from its file and the model in its folder; errors become its ``state`` and ``note``."""
    path = folder / found.path
    try:
        table = _table(path, found.kind)
        of_base = table["schema"] == _schemas(found.kind)[1]
        parameters = tuple(_of_base(table) if of_base else _OF_KIND[found.kind](table))
        arm, model = _model(path.parent / "model.toml")
        recorded = utc_date_of(table.get("recorded"))
        return Entry(
            path=found.path,
            kind=found.kind,
            date=recorded or utc_date(found.changed),
            date_of="recording" if recorded else "file",
            arm=arm,
            model=model,
            verdict=_verdict(found.kind, table),
            error=None if of_base else _error(found.kind, table),
            made_from=", ".join(dict.fromkeys(_sources(table))) or None,
            report=_report(folder, path),
            parameters=parameters,
        )
    except InputError as error:
        return Entry(path=found.path, kind=found.kind, state="unreadable", note=error.what)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        note = f"has another layout than a result of armscope: {type(error).__name__}: {error}"
        return Entry(path=found.path, kind=found.kind, state="unreadable", note=note)


def _table(path: Path, kind: str) -> Table:
    text = read_text(path)
    try:
        table = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"is no JSON: {error}") from None
    if not isinstance(table, dict) or table.get("schema") not in _schemas(kind):
        raise InputError(path, f"is no result of armscope ({_schemas(kind)[0]})")
    check_plain(path, table)
    return table


def _schemas(kind: str) -> tuple[str, str]:
    """Schemas of a result of the arm, and of the floating base that carries it."""
    return f"armscope.{kind}/1", f"armscope.base_{kind}/1"


def _model(path: Path) -> tuple[str | None, str | None]:
    """Name and content hash of the model in the folder of a result; None if there is no readable one."""
    try:
        data = read_file(path)
        name = toml_of(data.decode(), str(path)).get("name")
    except (InputError, UnicodeDecodeError):
        return None, None
    return name if isinstance(name, str) else None, hashlib.sha256(data).hexdigest()


def _sources(table: Mapping[str, Any]) -> Iterator[str]:
    for side in ("fit", "held_out", "before", "after"):
        listed = table.get(side)
        yield from (Path(str(one)).name for one in (listed if isinstance(listed, list) else ()))


def _report(folder: Path, path: Path) -> str | None:
    for name in ("compare.html",) if path.name == "compare.json" else ("report.html",):
        if (path.parent / name).is_file():
            return (path.parent / name).relative_to(folder).as_posix()
    return None


def _verdict(kind: str, table: Mapping[str, Any]) -> str | None:
    if kind == "diagnosis":
        causes = [
            str(one["effect"]) + ("" if one["joint"] is None else f" of joint {one['joint']}")
            for one in table["causes"]
        ]
        return str(table["verdict"]) + (f": {', '.join(causes)}" if causes else "")
    if kind == "comparison":
        return "changed" if table["changed"] else "no significant change"
    return str(table["method"]) if kind == "identification" else None


def _error(kind: str, table: Mapping[str, Any]) -> float | None:
    value = None
    if kind == "identification":
        value = table["relative_error"].get("held_out")
    elif kind == "kinematics":
        value = (table["position_rms"].get("held_out") or table["position_rms"]["fit"])["after"]
    return None if value is None or not math.isfinite(value) else float(value)


def _identified(table: Table) -> Iterator[Parameter]:
    """Standard parameters that the data determine, then base parameters that are combinations of several."""
    names = set()
    for one in table["parameters"]:
        if one["identifiable"] and one["value"] is not None:
            names.add(str(one["name"]))
            yield _parameter(str(one["name"]), one)
    for one in table["base_parameters"]:
        if one["value"] is not None and str(one["expression"]) not in names:
            yield _parameter(str(one["expression"]), one)


def _diagnosed(table: Table) -> Iterator[Parameter]:
    for cause in table["causes"]:
        head = "" if cause["joint"] is None else f"joint{int(cause['joint'])}."
        for name, one in cause["parameters"].items():
            yield _parameter(f"{head}{cause['effect']}.{name}", one)


def _of_base(table: Table) -> Iterator[Parameter]:
    """Parameters of a floating base that the data determine, or values of its causes."""
    for one in table.get("parameters", ()):
        if one["identifiable"] and one["value"] is not None:
            yield _parameter(str(one["name"]), one)
    for cause in table.get("causes", ()):
        for name, one in cause["parameters"].items():
            yield _parameter(f"{cause['effect']}.{name}", one)


def _calibrated(table: Table) -> Iterator[Parameter]:
    units = {"theta": "rad", "alpha": "rad", "beta": "rad", "a": "m", "d": "m"}
    for one in table["parameters"]:
        for name, std in (one.get("std") or {}).items():
            if name in units and one.get(name) is not None:
                value = {"value": one[name], "std": std, "unit": units[name]}
                yield _parameter(f"joint{int(one['joint'])}.{name}", value)


_OF_KIND = {
    "identification": _identified,
    "diagnosis": _diagnosed,
    "kinematics": _calibrated,
    # states changes, not values of the arm
    "comparison": lambda _: iter(()),
}


def _parameter(name: str, one: Mapping[str, Any]) -> Parameter:
    std = one.get("std")
    return Parameter(
        name=name,
        value=float(one["value"]),
        std=float(std) if std is not None and math.isfinite(std) and std > 0 else None,
        unit=str(one.get("unit", "")),
    )
