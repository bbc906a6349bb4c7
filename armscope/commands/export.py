"""``armscope export``: a recording becomes a table."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from armscope.commands.options import Json
from daq.recording import open_long, write_csv


def command(
    recording: Annotated[Path, typer.Argument(help="RUN.mcap")],
    out: Annotated[Path, typer.Option(help="the CSV to write (replaced if it is there)")],
    as_json: Json = False,
) -> None:
    data = open_long(recording)
    columns = write_csv(out, data)
    if data.layout.points == "tracker" and data.base_from_tracker is None:
        print("the tracker points are left out: the rig file has no base_from_tracker", file=sys.stderr)
    if as_json:
        print(json.dumps({"file": str(out), "rows": len(data), "columns": columns, "lost": data.ledger.lost}))
    else:
        print(f"{out}: {len(data)} rows, columns {', '.join(columns)}")
