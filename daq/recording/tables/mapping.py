"""A mapping: which column of a foreign table is which signal, and in which unit (docs/recordings.md)."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field, model_validator

from arm_io import InputError, check_table, read_toml
from arm_io.table import Table
from arm_io.types import Array
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.tables.csv_time import TimeUnit

_LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254}
_POSITIONS = {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "rev": 2 * np.pi} | _LENGTHS
UNITS: dict[str, dict[str, float]] = {
    "t": {unit.value: 1.0 for unit in TimeUnit},
    "q": _POSITIONS,
    "qref": _POSITIONS,
    "ql": _POSITIONS,
    "i": {"A": 1.0, "mA": 1e-3, "N m": 1.0, "N": 1.0, "drive": 1.0, "%": 1.0},
    "v": {"V": 1.0, "mV": 1e-3},
    "temp": {"degC": 1.0},
    "xyz": _LENGTHS,
}
"""Signal -> its units, and what a number in each is multiplied by; t is converted in decimal arithmetic instead."""
TORQUES = {"N m", "N"}
"""Units of ``i`` that are no currents: of torques, and of forces of sliding joints."""
_NUMBER = re.compile(r"\{([01])\}")
Factor = Annotated[float, Field(gt=-1e12, lt=1e12)]


class _Columns(Table):
    """Ours = theirs: one name with {0} or {1} for the number of the joint from 0 or from 1, or one name per joint."""

    t: str
    q: str | list[str]
    i: str | list[str]
    qref: str | list[str] | None = None
    ql: str | list[str] | None = None
    v: str | list[str] | None = None
    temp: str | list[str] | None = None
    x: str | None = None
    y: str | None = None
    z: str | None = None


@dataclass(frozen=True)
class Picked:
    """A column of the file, under its name here; ``factor`` is what its numbers are multiplied by."""

    name: str
    column: str
    factor: float = 1.0

    def of(self, columns: dict[str, Array]) -> Array:
        """(n,) the column in our unit."""
        values = columns[self.column]
        return values if self.factor == 1.0 else values * self.factor


class Named(Protocol):
    """A file with named columns."""

    path: Path
    where: str

    @property
    def names(self) -> Sequence[str]: ...


class Mapping(Table):
    """The mapping of a table's columns. ``separator`` and ``decimal`` are those of a text.

    units  signal -> unit of ``UNITS``, one or one per joint (an arm that slides and turns); scale: signal -> factor of
           the measured value, one or one per joint (-1: sign)
    """

    separator: Literal[",", ";", "\t", " ", "|"] = ","
    decimal: Literal[".", ","] = "."
    columns: _Columns
    units: dict[Literal["t", "q", "i", "qref", "ql", "v", "temp", "xyz"], str | list[str]] = Field(default={})
    scale: dict[Literal["q", "i", "qref", "ql", "v", "temp", "xyz"], Factor | list[Factor]] = Field(default={})

    @model_validator(mode="after")
    def _understood(self) -> Mapping:
        if self.separator == self.decimal:
            raise ValueError("separator and decimal are both ','")
        for signal, given in self.units.items():
            if isinstance(given, list) and signal == "t":
                raise ValueError("units.t: must be one unit")
            for unit in given if isinstance(given, list) else [given]:
                if unit not in UNITS[signal]:
                    raise ValueError(f"units.{signal}: {unit!r} is unknown; must be one of {', '.join(UNITS[signal])}")
        for signal, factor in self.scale.items():
            if 0.0 in (factor if isinstance(factor, list) else [factor]):
                raise ValueError(f"scale.{signal}: 0 leaves nothing of the measured value; must be another factor")
        effort = self.units.get("i", "")
        if isinstance(effort, list) and 0 < sum(unit in TORQUES for unit in effort) < len(effort):
            raise ValueError("units.i: must be torques (N m) or forces (N) of all joints, or currents of all")
        return self

    @property
    def time_unit(self) -> TimeUnit | None:
        """Of t, where it is given."""
        return TimeUnit(str(self.units["t"])) if "t" in self.units else None

    @property
    def torques(self) -> bool:
        """Whether ``i`` holds torques at the joints, N m (N)."""
        return not TORQUES.isdisjoint(self.units_of("i", 1))

    def joint_types(self, joints: int) -> list[str]:
        """What each of ``joints`` is by the unit of its position: prismatic or revolute; empty if none is stated."""
        return ["prismatic" if unit in _LENGTHS else "revolute" for unit in self.units_of("q", joints)]

    def units_of(self, signal: str, count: int) -> list[str]:
        """The unit of each of ``count`` columns of a signal, or as many as the mapping lists; empty if not stated."""
        unit = self.units.get(signal, [])  # type: ignore[call-overload]
        return unit if isinstance(unit, list) else [unit] * count

    def pick(self, table: Named, *, keep_extra: bool = False) -> list[Picked]:
        """The columns of a table that are mapped; with ``keep_extra`` the others under their own names.

        InputError where one is not there.
        """
        picked = [Picked("t", self.columns.t)]
        for signal in JOINT_TOPICS:
            wanted = getattr(self.columns, signal)
            if wanted is not None:
                picked += self._joints(table, signal, wanted)
        for axis in "xyz":
            column = getattr(self.columns, axis)
            if column is not None:
                picked.append(Picked(axis, column, self._factor(table, "xyz", "xyz".index(axis), 3)))
        there = set(table.names)
        for one in picked:
            if one.column not in there:
                raise _absent(table, one.name, one.column)
        first: dict[str, str] = {}
        for one in picked:
            if (name := first.setdefault(one.column, one.name)) != one.name:
                raise InputError(table.path, f"{one.name} and {name} of the mapping are both column {one.column!r}")
        if keep_extra:
            taken = {name for one in picked for name in (one.name, one.column)}
            picked += [Picked(name, name) for name in table.names if name not in taken]
        return picked

    def left_out(self, table: Named) -> list[str]:
        """The columns of a table that ``pick`` does not take, unless it keeps all."""
        taken = {one.column for one in self.pick(table)}
        return [name for name in table.names if name not in taken]

    def _joints(self, table: Named, signal: str, wanted: str | list[str]) -> list[Picked]:
        names = wanted if isinstance(wanted, list) else _numbered(table, wanted)
        if not names:
            raise _absent(table, signal, _column(str(wanted), 0))
        factors = [self._factor(table, signal, place, len(names)) for place in range(len(names))]
        return [Picked(f"{signal}{j}", name, factors[j - 1]) for j, name in enumerate(names, 1)]

    def _factor(self, table: Named, signal: Any, place: int, count: int) -> float:
        scale = self.scale.get(signal, 1.0)
        if isinstance(scale, list) and len(scale) != count:
            raise InputError(table.path, f"scale.{signal} of the mapping has {len(scale)} entries for {count} columns")
        one = scale[place] if isinstance(scale, list) else scale
        if not (units := self.units_of(signal, count)):
            return one
        if len(units) != count:
            raise InputError(table.path, f"units.{signal} of the mapping has {len(units)} entries for {count} columns")
        return one * UNITS[signal][units[place]]

    def text(self) -> str:
        """The mapping as a file has it."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(exclude_none=True, exclude_defaults=True))

    def in_words(self) -> str:
        """One line: which column is which, and the units that are not ours."""
        columns = self.columns.model_dump(exclude_none=True)
        pairs = [f"{ours} = {_listed(theirs)}" for ours, theirs in columns.items()]
        units = [f"{signal} in {', '.join(self.units_of(signal, 1))}" for signal in self.units]
        names = {" ": "blanks", "\t": "tabs", ";": "semicolons", "|": "bars"}
        text = [f"columns separated by {names[self.separator]}"] if self.separator in names else []
        return "; ".join([*pairs, *units, *text, *(["decimal commas"] if self.decimal == "," else [])])


def _listed(columns: str | Sequence[str]) -> str:
    """Columns one after the other; what all have up to their last dot is said once, as of topics of ROS 2."""
    if isinstance(columns, str):
        return columns
    begin, *others = {name.rpartition(".")[0] for name in columns}
    if len(columns) < 3 or others or not begin.startswith("/"):
        return ", ".join(columns)
    return f"{begin} of {', '.join(name[len(begin) + 1 :] for name in columns)}"


def read_mapping(path: str | Path) -> Mapping:
    """The mapping in a TOML file; InputError names the wrong entry, and what would be right."""
    return check_table(path, read_toml(path), Mapping)


def _numbered(table: Named, pattern: str) -> list[str]:
    """The columns that a pattern names, from the first joint on to the last that is there."""
    if not _NUMBER.search(pattern):
        return [pattern]
    there: set[str] = set(table.names)
    names: list[str] = []
    while (name := _column(pattern, len(names))) in there:
        names.append(name)
    return names


def _column(pattern: str, joint: int) -> str:
    """The name of a joint's column, joints counted from 0."""
    return _NUMBER.sub(lambda found: str(joint + int(found[1])), pattern)


def _absent(table: Named, ours: str, column: str) -> InputError:
    close = difflib.get_close_matches(column, list(table.names)[:1000], 1, 0.5)
    hint = (
        f"is it {close[0]!r}?"
        if close
        else f"the table has {', '.join(list(table.names)[:8])}" + ", .." * (len(table.names) > 8)
    )
    return InputError(
        table.path, f"{table.where}there is no column {column!r}, which the mapping names for {ours}; {hint}"
    )
