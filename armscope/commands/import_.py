"""``armscope import``: measured data from elsewhere becomes a recording."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from arm_io import read_text
from armscope.commands.options import Json, RecordingOut
from daq.recording import Attachments, Table, TimeUnit, read_csv_blocks, write_blocks
from daq.recording.provenance import file_identity, provenance
from daq.rig import read_rig


def command(
    table: Annotated[Path, typer.Argument(help="CSV: t, q1.., i1.., and qref, ql, v, temp by joint, x, y, z")],
    out: RecordingOut,
    rig: Annotated[Path | None, typer.Option(help="rig file with the joints; default: joints from the columns")] = None,
    keep_extra: Annotated[bool, typer.Option("--keep-extra", help="keep columns with unknown names")] = False,
    time_unit: Annotated[
        TimeUnit | None, typer.Option("--time-unit", help="unit of the column t; required if it does not look like s")
    ] = None,
    as_json: Json = False,
) -> None:
    checked = None if rig is None else read_rig(rig, drivers=False)
    joints = None if checked is None else checked.joints
    blocks = _Blocks(read_csv_blocks(table, joints=joints, keep_extra=keep_extra, unit=time_unit))
    first = next(blocks)
    model = None if checked is None else checked.model_path
    attachments = Attachments(
        rig=None if rig is None else read_text(rig),
        model=None if model is None else read_text(model),
        provenance=provenance("imported", source=file_identity(table), **_epoch(first)),
    )
    names = [] if checked is None else [joint.name or f"joint{number}" for number, joint in enumerate(checked.joint, 1)]
    write_blocks(out, first, blocks, attachments, joints=names)
    rows, seconds = blocks.rows, blocks.last - float(first.t[0])
    if as_json:
        print(json.dumps({"file": str(out), "rows": rows, "joints": first.joints, "duration": seconds, "lost": 0}))
    else:
        gaps = f", {blocks.missing} rows with missing samples" if blocks.missing else ""
        print(f"{out}: {rows} rows of {first.joints} joint{'s' * (first.joints > 1)}, {seconds:.2f} s{gaps}")


class _Blocks(Iterator[Table]):
    """The blocks of a table, counted as they go by: rows, those with missing samples, and the last time, s."""

    def __init__(self, blocks: Iterator[Table]) -> None:
        self._blocks = blocks
        self.rows = self.missing = 0
        self.last = 0.0

    def __next__(self) -> Table:
        block = next(self._blocks)
        self.rows += len(block)
        self.missing += block.rows_with_missing_samples
        self.last = float(block.t[-1])
        return block


def _epoch(data: Table) -> dict[str, str]:
    """When the first row was, s since 1970, as ``export`` gives it back."""
    return {} if data.epoch is None else {"epoch": str(data.epoch)}
