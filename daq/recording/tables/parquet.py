"""Parquet read as a table, some rows at a time (``pip install 'armscope[parquet]'``)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular
from arm_io.optional import optional
from daq.recording.tables.columns import Chunk, Exact
from daq.recording.tables.csv_time import TimeUnit
from daq.recording.tables.mapping import Mapping

ROWS = 1 << 14


class ParquetSource:
    """A Parquet file as a source of columns (``daq.recording.tables.columns.Source``).

    Numbers of any width; instants (timestamp) become ns since 1970, durations ns. InputError where it cannot be read.
    """

    word, where = "row", ""
    mapping: Mapping | None = None

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        os.close(open_regular(path))
        self._arrow = optional("pyarrow", "parquet", path)
        self._parquet = optional("pyarrow.parquet", "parquet", path)
        file = self._file()
        self.rows: int | None = file.metadata.num_rows
        self._types = {field.name: field.type for field in file.schema_arrow}
        self.names: list[str] = list(self._types)

    def chunks(self, needed: Sequence[str], time: str) -> Iterator[Chunk]:
        """All rows in their order."""
        row = 0
        try:
            for batch in self._batches(list(dict.fromkeys(needed))):
                arrays = {name: self._numbers(name, batch.column(name)) for name in needed}
                numbers = {name: values.astype(float) for name, values in arrays.items()}
                yield Chunk(range(row + 1, row + 1 + len(batch)), numbers, Exact(arrays[time]))
                row += len(batch)
        except (self._arrow.ArrowException, OSError) as error:
            raise self._broken(error) from None

    def last_time(self, time: str) -> str:
        """Of the last row group."""
        file = self._file()
        try:
            if not file.num_row_groups:
                return ""
            last = file.read_row_group(file.num_row_groups - 1, columns=[time]).column(time)
            return Exact(self._numbers(time, last[-1:].combine_chunks()))[0] if len(last) else ""
        except (self._arrow.ArrowException, OSError) as error:
            raise self._broken(error) from None

    def unit_of(self, time: str) -> TimeUnit | None:
        """Ns of instants and durations."""
        return TimeUnit.NS if self._is_time(time) else None

    def _is_time(self, name: str) -> bool:
        types, kind = self._arrow.types, self._types[name]
        return bool(types.is_timestamp(kind) or types.is_duration(kind))

    def _batches(self, columns: list[str]) -> Iterator[Any]:
        """All rows, one row group after the other: read at once, pyarrow holds on to those that have passed."""
        file = self._file()
        for group in range(file.num_row_groups):
            yield from file.iter_batches(ROWS, row_groups=[group], columns=columns)

    def _numbers(self, name: str, column: Any) -> Any:
        """(n,) int64 of instants and whole numbers without gaps, else float64 with NaN for nulls."""
        types, kind = self._arrow.types, self._types[name]
        if self._is_time(name):
            exact = self._arrow.timestamp("ns", kind.tz) if types.is_timestamp(kind) else self._arrow.duration("ns")
            column = column.cast(exact).cast(self._arrow.int64())
        elif not (types.is_integer(kind) or types.is_floating(kind)):
            raise InputError(self.path, f"column {name!r} is of type {kind}; it must hold numbers")
        if column.null_count or types.is_floating(column.type):
            column = column.cast(self._arrow.float64(), safe=False)
        return np.asarray(column.to_numpy(zero_copy_only=False))

    def _file(self) -> Any:
        try:
            return self._parquet.ParquetFile(self.path)
        except (self._arrow.ArrowException, OSError, ValueError) as error:
            raise self._broken(error) from None

    def _broken(self, error: Exception) -> InputError:
        return InputError(self.path, f"cannot be read as Parquet: {error}")
