"""A recording as Parquet: the columns of docs/recordings.md, a row group per block of rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from arm_io import whole_path
from arm_io.optional import optional
from daq.recording.blocks import LongRecording
from daq.recording.tables.exported import columns_of, units_of

ROWS = 1 << 16
"""Of a row group."""


def write_parquet(path: str | Path, recording: LongRecording) -> list[str]:
    """Writes a recording, whole or not at all; returns the names of the columns. NaN: missing sample.

    Each field has its unit in its metadata, the file the name of the recording, and s since 1970 at t = 0, if the table
    had it. InputError where pyarrow is not installed, or the file cannot be written.
    """
    arrow, parquet = optional("pyarrow", "parquet", path), optional("pyarrow.parquet", "parquet", path)
    units, names = units_of(recording), list(columns_of(next(recording.blocks())))
    fields = [
        arrow.field(name, arrow.float64(), metadata={"unit": units[name]} if name in units else None) for name in names
    ]
    about = {"recording": recording.path.name} | {
        key: recording.provenance[key] for key in ("epoch",) if key in recording.provenance
    }
    schema = arrow.schema(fields, metadata=about)
    with whole_path(path) as place, parquet.ParquetWriter(place, schema, compression="zstd") as writer:
        waiting: list[dict[str, Any]] = []
        for block in recording.blocks():
            waiting.append({name: values.copy() for name, values in columns_of(block).items()})
            if sum(len(one["t"]) for one in waiting) >= ROWS:
                writer.write_table(_table(arrow, schema, waiting))
                waiting = []
        writer.write_table(_table(arrow, schema, waiting))
    return names


def _table(arrow: Any, schema: Any, blocks: list[dict[str, Any]]) -> Any:
    columns = [np.concatenate([np.empty(0), *(one[name] for one in blocks)]) for name in schema.names]
    return arrow.table(columns, schema=schema)
