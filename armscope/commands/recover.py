"""``armscope recover``: everything that can be read of an unfinished or damaged recording, and what was lost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from armscope.commands.options import Json
from armscope.progress import shown
from daq.acquisition import SENTENCES
from daq.recording import ledger_table
from daq.recording.recover import recover


def command(
    recording: Annotated[
        Path, typer.Argument(metavar="RUN.mcap.active", help="the unfinished recording, or a damaged RUN.mcap")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="RUN.mcap", help="the recording to write; default: without '.active'")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="replace an existing recording")] = False,
    as_json: Json = False,
) -> int:
    with shown(as_json):
        result = recover(recording, out, replace=force)
    if as_json:
        print(
            json.dumps(
                {"file": str(result.path), "sure": result.sure, "notes": result.notes, **ledger_table(result.ledger)}
            )
        )
        return 0 if result.complete else 4
    ledger = result.ledger
    print(f"{result.path}: {ledger.recorded} of {ledger.triggers} rows{'' if ledger.lost else ', nothing is missing'}")
    for loss in ledger.losses:
        last = loss.first + loss.rows - 1
        detail = f" ({loss.detail})" if loss.detail else ""
        print(f"  lost: rows {loss.first} to {last} ({loss.rows}): {SENTENCES[loss.reason]}{detail}")
    return 0 if result.complete else 4
