"""A table as another program would have logged it: columns that it lacks, steps, gaps, a joint that stands."""

from __future__ import annotations

import csv
import io

import numpy as np

Generator = np.random.Generator
Columns = dict[str, np.ndarray]
SHARE = 0.15
"""of the changes, a table gets so many."""


def as_logged_elsewhere(text: str, rng: Generator) -> str:
    """The table with some of ``CHANGES``; the same ones for a generator of the same state, as one program would."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    header, *rows = csv.reader(lines)
    numbers = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows]).T
    table = {name: column.copy() for name, column in zip(header, numbers)}
    for change in CHANGES:
        if rng.random() < SHARE:
            change(table, rng)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    for row in zip(*table.values()):
        writer.writerow(["" if np.isnan(value) else repr(float(value)) for value in row])
    return out.getvalue()


def _joints(table: Columns) -> int:
    return sum(name[0] == "q" and name[1:].isdigit() for name in table)


def _joint(table: Columns, rng: Generator) -> int:
    return int(rng.integers(1, _joints(table) + 1))


def _without(*prefixes: str):
    def change(table: Columns, _: Generator) -> None:
        for name in [one for one in table if one.rstrip("0123456789") in prefixes]:
            del table[name]

    return change


def _standing(table: Columns, rng: Generator) -> None:
    """A joint at rest, its brake closed: no current either."""
    number = _joint(table, rng)
    for name in (f"q{number}", f"qref{number}", f"ql{number}"):
        if name in table:
            table[name][:] = table[name][0]
    table[f"i{number}"][:] = 0.0


def _currents_of_a_joint(table: Columns, rng: Generator) -> None:
    """All of them zero, equal or missing."""
    table[f"i{_joint(table, rng)}"][:] = rng.choice([0.0, 1.5, np.nan])


def _demands_of_a_joint(table: Columns, rng: Generator) -> None:
    if (name := f"qref{_joint(table, rng)}") in table:
        table[name][:] = np.nan


def _cells(table: Columns, rng: Generator) -> None:
    """Of a column, a third of the rows or one row."""
    name = [name for name in table if name != "t"][int(rng.integers(len(table) - 1))]
    where = rng.random(len(table[name])) < rng.choice([0.3, 1.5 / len(table[name])])
    table[name][where] = np.nan


def _rows(table: Columns, rng: Generator) -> None:
    """Every second row, the rows of a second missing, or none of the standstill at the begin."""
    count, kind = len(table["t"]), int(rng.integers(3))
    kept = np.arange(count)
    kept = (
        kept[::2] if kind == 0 else np.delete(kept, slice(count // 3, count // 2)) if kind == 1 else kept[count // 4 :]
    )
    for name in table:
        table[name] = table[name][kept]


def _steps(table: Columns, rng: Generator) -> None:
    """Angles and currents of a coarse encoder and converter."""
    q, i = rng.choice([1e-5, 1e-3]), rng.choice([1e-3, 0.1])
    for name, column in table.items():
        kind = name.rstrip("0123456789")
        step = q if kind in ("q", "ql", "qref") else i if kind == "i" else 0.0
        if step:
            column[:] = np.round(column / step) * step


def _clock(table: Columns, rng: Generator) -> None:
    """Seconds since 1970, and jitter of a hundredth of a row."""
    t = table["t"]
    t += rng.choice([0.0, 1.7e9]) + 0.01 * np.median(np.diff(t)) * rng.uniform(-1.0, 1.0, len(t))


def _link_encoders(table: Columns, rng: Generator) -> None:
    for number in range(1, _joints(table) + 1):
        table[f"ql{number}"] = table[f"q{number}"] + 1e-5 * rng.normal(size=len(table["t"]))


def _temperatures(table: Columns, rng: Generator) -> None:
    span = rng.choice([0.0, 0.5, 20.0])
    for number in range(1, _joints(table) + 1):
        table[f"temp{number}"] = 30.0 + span * np.linspace(0.0, 1.0, len(table["t"]))


def _tracker(table: Columns, rng: Generator) -> None:
    """Noise, or one point that is far away."""
    for name in {"x", "y", "z"} & set(table):
        table[name] += 1e-4 * rng.normal(size=len(table[name]))
        table[name][len(table[name]) // 2] += rng.choice([0.0, 0.5])


CHANGES = (
    _without("qref"),
    _without("x", "y", "z"),
    _rows,
    _clock,
    _link_encoders,
    _temperatures,
    _tracker,
    _steps,
    _standing,
    _currents_of_a_joint,
    _demands_of_a_joint,
    _cells,
)
