"""The results of a plan as Parquet: one row per task, per cause and per parameter (docs/fleet.md lists the columns)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_fleet.tasks.cluster import EXTRA
from arm_fleet.tasks.store import Record
from arm_io import InputError, whole_path
from arm_io.optional import optional

Row = dict[str, Any]
TASKS = {
    "arm": "string",
    "night": "date32",
    "state": "string",
    "reason": "string",
    "verdict": "string",
    "rows": "int64",
    "lost": "int64",
    "recording_bytes": "int64",
    "read_bytes": "int64",
    "relative_error": "float64",
    "p": "float64",
    "p_corrected": "float64",
    "named": "bool_",
    "seconds": "float64",
    "cpu_seconds": "float64",
    "peak_bytes": "int64",
    "worker": "string",
    "code": "string",
    "key": "string",
}
CAUSES = {
    "arm": "string",
    "night": "date32",
    "effect": "string",
    "joint": "int32",
    "parameter": "string",
    "value": "float64",
    "std": "float64",
    "unit": "string",
    "confidence": "float64",
    "ambiguity_group": "string",
    "key": "string",
}
PARAMETERS = {
    "arm": "string",
    "night": "date32",
    "parameter": "string",
    "value": "float64",
    "std": "float64",
    "unit": "string",
    "key": "string",
}


def write_tables(folder: Path, records: Sequence[Record], named: Mapping[str, Row]) -> None:
    """Writes tasks.parquet, causes.parquet and parameters.parquet, each whole or not at all.

    named  key -> p, p_corrected and named of a night (``arm_fleet.judging.alarms``)
    InputError where they cannot be written.
    """
    nights = [one for one in records if one["night"]]
    _write(folder / "tasks.parquet", TASKS, [_task(one, named.get(one["key"], {})) for one in records])
    _write(folder / "causes.parquet", CAUSES, [row for one in nights for row in _causes(one)])
    _write(folder / "parameters.parquet", PARAMETERS, [row for one in nights for row in _parameters(one)])


def _task(record: Record, named: Row) -> Row:
    value = record["value"]
    return {
        "arm": record["arm"],
        "night": record["night"],
        "state": record["state"],
        "reason": record["reason"],
        "verdict": value.get("verdict"),
        "rows": value.get("rows"),
        "lost": value.get("lost"),
        "recording_bytes": value.get("bytes"),
        "read_bytes": value.get("read_bytes"),
        "relative_error": (value.get("relative_error") or {}).get("held_out"),
        "p": named.get("p"),
        "p_corrected": named.get("p_corrected"),
        "named": named.get("named"),
        "seconds": record["seconds"],
        "cpu_seconds": record["cpu_seconds"],
        "peak_bytes": record["peak_bytes"],
        "worker": record["worker"],
        "code": record["code"],
        "key": record["key"],
    }


def _causes(record: Record) -> list[Row]:
    head = {"arm": record["arm"], "night": record["night"], "key": record["key"]}
    return [
        head
        | {"effect": cause["effect"], "joint": cause["joint"], "parameter": name, "confidence": cause["confidence"]}
        | {name_: one[name_] for name_ in ("value", "std", "unit")}
        | {"ambiguity_group": "; ".join(_words(member) for member in cause["group"])}
        for cause in record["value"].get("causes", ())
        for name, one in cause["parameters"].items()
    ]


def _parameters(record: Record) -> list[Row]:
    head = {"arm": record["arm"], "night": record["night"], "key": record["key"]}
    return [
        head | {"parameter": one["name"]} | {name: one[name] for name in ("value", "std", "unit")}
        for one in record["value"].get("parameters", ())
    ]


def _words(member: Mapping[str, Any]) -> str:
    return str(member["effect"]) + ("" if member["joint"] is None else f" of joint {member['joint']}")


def _write(path: Path, columns: Mapping[str, str], rows: Sequence[Row]) -> None:
    arrow = optional("pyarrow", EXTRA, path)
    parquet = optional("pyarrow.parquet", EXTRA, path)
    schema = arrow.schema([(name, getattr(arrow, kind)()) for name, kind in columns.items()])
    made = {
        name: arrow.array([_cell(row[name], kind) for row in rows], schema.field(name).type)
        for name, kind in columns.items()
    }
    with whole_path(path) as part:
        try:
            parquet.write_table(arrow.table(made, schema=schema), part, compression="zstd")
        except OSError as error:
            raise InputError(path, f"cannot be written: {error}") from None


def _cell(value: Any, kind: str) -> Any:
    if kind == "date32":
        from datetime import date

        return date.fromisoformat(value) if value else None
    return float(value) if kind == "float64" and value is not None else value
