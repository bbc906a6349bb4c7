"""``armscope import``: measured data from elsewhere becomes a recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from arm_io import read_text
from daq.recording import Attachments, Table, TimeUnit, read_csv, write_table
from daq.recording.provenance import file_identity, provenance
from daq.rig import read_rig


def command(
    table: Annotated[Path, typer.Argument(help="CSV: t, q1.., i1.., and qref, ql, v, temp by joint, x, y, z")],
    out: Annotated[Path, typer.Option(help="the recording to write (replaced if it is there)")],
    rig: Annotated[Path | None, typer.Option(help="rig file with the joints; without it the columns tell")] = None,
    keep_extra: Annotated[bool, typer.Option("--keep-extra", help="keep columns with unknown names")] = False,
    time_unit: Annotated[
        TimeUnit | None, typer.Option("--time-unit", help="of the column t; asked for where it does not look like s")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    checked = None if rig is None else read_rig(rig, drivers=False)
    data = read_csv(table, joints=None if checked is None else checked.joints, keep_extra=keep_extra, unit=time_unit)
    model = None if checked is None else checked.model_path
    attachments = Attachments(
        rig=None if rig is None else read_text(rig),
        model=None if model is None else read_text(model),
        provenance=provenance("imported", source=file_identity(table), **_epoch(data)),
    )
    names = [] if checked is None else [joint.name or f"joint{number}" for number, joint in enumerate(checked.joint, 1)]
    write_table(
        out, data.t, data.signals, attachments, joints=names, xyz=data.xyz, extra=data.extra, start_ns=data.start_ns
    )
    missing = data.rows_with_missing_samples
    rows, seconds = len(data.t), float(data.t[-1] - data.t[0])
    if as_json:
        print(json.dumps({"file": str(out), "rows": rows, "joints": data.joints, "duration": seconds, "lost": 0}))
    else:
        gaps = f", {missing} rows with missing samples" if missing else ""
        print(f"{out}: {rows} rows of {data.joints} joint{'s' * (data.joints > 1)}, {seconds:.2f} s{gaps}")


def _epoch(data: Table) -> dict[str, str]:
    """When the first row was, s since 1970, as ``export`` gives it back."""
    return {} if data.epoch is None else {"epoch": str(data.epoch)}
