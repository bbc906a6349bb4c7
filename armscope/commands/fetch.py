"""``armscope fetch``: brings a recording from the folder of a daemon, or lists what is there."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from arm_io import InputError
from armscope.commands.options import Json
from daq.rig import read_rig
from daq.service import call, keys_of, open_session
from daq.service.transfer import fetch

Table = dict[str, Any]


def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="the rig whose daemon has the recording")],
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="name of the recording; default: list all recordings")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="file to write; default: NAME in the working directory")
    ] = None,
    as_json: Json = False,
) -> None:
    checked = read_rig(rig, drivers=False)
    keys = keys_of(checked.name)
    if name is None and out is not None:
        raise InputError("--out", "needs NAME, the recording to fetch")
    with open_session(checked, listen=False) as session:
        if name is None:
            answer = call(session, keys, "recordings")
            print(json.dumps(answer) if as_json else _listed(answer))
            return
        with transfer_shown(as_json) as transfer:
            result = fetch.fetch(session, keys, name, Path(Path(name).name) if out is None else out, transfer)
    resumed = f", {result['resumed']} of them from an earlier attempt" if result["resumed"] else ""
    print(json.dumps(result) if as_json else f"{result['file']}: {result['bytes']} bytes{resumed}; checksum verified")


@contextmanager
def transfer_shown(as_json: bool) -> Iterator[Callable[[int, int], None]]:
    """Shows how much is fetched, on standard error where that is a terminal and no JSON is asked for."""
    if as_json or not sys.stderr.isatty():
        yield lambda done, size: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    columns = (TextColumn("fetching"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task("", total=None)

    def show(done: int, size: int) -> None:
        bar.start()
        bar.update(task, completed=done, total=size)

    try:
        yield show
    finally:
        bar.stop()


def _listed(answer: Table) -> str:
    if not answer["recordings"]:
        return f"{answer['folder']}: no recordings"
    width = max(len(entry["name"]) for entry in answer["recordings"])
    lines = [
        f"{entry['name']:<{width}}  {entry['bytes']:>14}  "
        f"{datetime.fromtimestamp(entry['changed_ns'] * 1e-9).isoformat(' ', 'seconds')}"
        for entry in answer["recordings"]
    ]
    return "\n".join(lines)
