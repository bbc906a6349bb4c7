"""``armscope fleet``: many arms and nights on Dask; which arms changed, since when, how fast, what to do."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError, check_folder
from arm_io.json_text import json_text
from armscope.commands.options import Json
from armscope.exit_status import DONE, SAMPLES_LOST
from armscope.progress import shown


def command(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="arms, their recordings, what to compute")],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="folder for the results; results already in it are not computed again")
    ],
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="a running Dask scheduler; default: workers of this machine"),
    ] = None,
    workers: Annotated[
        int,
        typer.Option(min=1, max=1024, help="number of worker processes on this machine; each runs one task at a time"),
    ] = 1,
    as_json: Json = False,
) -> int:
    """Runs a plan; the exit status is 4 where tasks have no result."""
    from arm_report import wrapped
    from armscope.api.fleet import fleet

    check_folder(out)
    if scheduler is not None and workers != 1:
        raise InputError("--workers", "are of this machine; must not be given with --scheduler")
    with shown(as_json) as progress:
        found = fleet(plan, out, scheduler=scheduler, workers=workers, progress=progress)
    if as_json:
        for note in found.notes:
            print(f"note: {note}", file=sys.stderr)
        print(json_text(found.to_json()))
    else:
        print(wrapped(f"{found}\n{out / 'fleet.html'}"))
    return SAMPLES_LOST if found.failed else DONE
