"""The results of a plan as Parquet: one row per task, per cause and per parameter (docs/fleet.md lists the columns)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from arm_fleet.judging.alarms import Alarm
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


COLUMNS = {"tasks": TASKS, "causes": CAUSES, "parameters": PARAMETERS}
GROUP = 100_000
"""Rows per row group; they are held in memory until they are written."""
Tables = dict[str, Any]
"""Name of a table -> some of its rows (pyarrow.Table)."""


def tables_of(records: Sequence[Record], alarms: Mapping[str, Alarm]) -> Tables:
    """Rows of the tables for some tasks; ``alarms``: by key of the task, of nights that could be compared."""
    nights = [one for one in records if one["night"]]
    rows = {
        "tasks": [_task(one, alarms.get(one["key"])) for one in records],
        "causes": [row for one in nights for row in _causes(one)],
        "parameters": [row for one in nights for row in _parameters(one)],
    }
    return {name: _table(columns, rows[name]) for name, columns in COLUMNS.items()}


@contextmanager
def tables_in(folder: Path) -> Iterator[Callable[[Tables], None]]:
    """Appends rows to tasks.parquet, causes.parquet and parameters.parquet; writes each file completely or not at all.

    InputError where they cannot be written.
    """
    with ExitStack() as stack:
        writers = {
            name: stack.enter_context(_writer(folder / f"{name}.parquet", columns)) for name, columns in COLUMNS.items()
        }

        def append(tables: Tables) -> None:
            for name, write in writers.items():
                write(tables[name])

        yield append


@contextmanager
def _writer(path: Path, columns: Mapping[str, str]) -> Iterator[Callable[[Any], None]]:
    arrow = optional("pyarrow", EXTRA, path)
    parquet = optional("pyarrow.parquet", EXTRA, path)
    pending: list[Any] = []
    with whole_path(path) as part:
        try:
            with parquet.ParquetWriter(part, _schema(columns), compression="zstd") as writer:

                def write(table: Any, least: int = GROUP) -> None:
                    pending.append(table)
                    if sum(one.num_rows for one in pending) >= least:
                        writer.write_table(arrow.concat_tables(pending))
                        pending.clear()

                yield write
                write(_table(columns, []), least=1)
        except OSError as error:
            raise InputError(path, f"cannot be written: {error}") from None


def _task(record: Record, alarm: Alarm | None) -> Row:
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
        "p": None if alarm is None else alarm.p,
        "p_corrected": None if alarm is None else alarm.corrected,
        "named": None if alarm is None else alarm.named,
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


def _schema(columns: Mapping[str, str]) -> Any:
    arrow = optional("pyarrow", EXTRA, "armscope fleet")
    return arrow.schema([(name, getattr(arrow, kind)()) for name, kind in columns.items()])


def _table(columns: Mapping[str, str], rows: Sequence[Row]) -> Any:
    arrow, schema = optional("pyarrow", EXTRA, "armscope fleet"), _schema(columns)
    made = {
        name: arrow.array([_cell(row[name], kind) for row in rows], schema.field(name).type)
        for name, kind in columns.items()
    }
    return arrow.table(made, schema=schema)


def _cell(value: Any, kind: str) -> Any:
    if kind == "date32":
        from datetime import date

        return date.fromisoformat(value) if value else None
    return float(value) if kind == "float64" and value is not None else value
