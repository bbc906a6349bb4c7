"""``armscope record``: one experiment to one file, through a running daemon or with an embedded one."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from armscope.api.reading import note_gaps
from armscope.api.recording import record
from armscope.commands.fetch import transfer_shown
from armscope.commands.options import Json, RigOption
from armscope.exit_status import DEVICE_FAILED, DONE, SAMPLES_LOST
from experiment import read_experiment

Table = dict[str, Any]


def command(
    rig: RigOption,
    experiment: Annotated[Path, typer.Option(metavar="EXP.toml", help="the motion")],
    out: Annotated[
        Path,
        typer.Option(
            metavar="RUN.mcap", help="the recording to write; a file name without folder if the daemon has --recordings"
        ),
    ],
    fetch: Annotated[bool, typer.Option("--fetch", help="copy the recording here from the daemon's folder")] = False,
    as_json: Json = False,
) -> int:
    from daq.rig import read_rig

    checked = read_rig(rig, drivers=False)
    if checked.space is not None:
        note_gaps(checked.model_path, "collisions")
    instruction = read_experiment(experiment).setup.instruction
    if instruction:
        print(f"before this run: {instruction}", file=sys.stderr)
    with run_shown(as_json) as progress, transfer_shown(as_json) as transfer:
        recorded = record(rig, experiment, out, fetch=fetch, progress=progress, transfer=transfer)
    result = recorded.to_json()
    print(json.dumps(result) if as_json else recorded)
    if recorded.fault:
        print(f"error: {result['ending']['sentence']}", file=sys.stderr)
    return status_of(result)


def status_of(result: Table) -> int:
    """The exit status of a run's result."""
    if result["ending"]["fault"]:
        return DEVICE_FAILED
    return SAMPLES_LOST if result["ledger"]["lost"] or result.get("missing") else DONE


@contextmanager
def run_shown(as_json: bool = False) -> Iterator[Callable[[Table], None]]:
    """Shows how far the run is, on standard error where that is a terminal and no JSON is asked for."""
    if as_json or not sys.stderr.isatty():
        yield lambda run: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    counts = TextColumn("{task.fields[rows]} rows, {task.fields[lost]} lost")
    columns = (TextColumn("recording"), BarColumn(), counts, TimeElapsedColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task("", total=1.0, rows=0, lost=0)

    def show(run: Table) -> None:
        bar.start()
        bar.update(task, completed=run["progress"] or 0.0, rows=run["rows"], lost=run["lost"])

    try:
        yield show
    finally:
        bar.stop()
