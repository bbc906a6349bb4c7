"""``armscope record``: one experiment to one file, through a running daemon or with an embedded one."""

from __future__ import annotations

import hashlib
import json
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from arm_io import DeviceFault, InputError, read_file, read_text
from armscope.commands.fetch import bring
from daq.rig import Rig, read_rig
from daq.service import RemoteServer, RigServer, server_of
from experiment import read_experiment

Table = dict[str, Any]
_DONE, _DEVICE_FAILED, _SAMPLES_LOST = 0, 3, 4


def command(
    rig: Annotated[Path, typer.Option(metavar="RIG.toml", help="the rig")],
    experiment: Annotated[Path, typer.Option(metavar="EXP.toml", help="the motion")],
    out: Annotated[
        Path,
        typer.Option(metavar="RUN.mcap", help="the recording to write; a plain name if the daemon has --recordings"),
    ],
    fetch: Annotated[bool, typer.Option("--fetch", help="bring the recording here from a daemon's folder")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> int:
    checked = read_rig(rig, drivers=False)
    instruction = read_experiment(experiment).setup.instruction
    if instruction:
        print(f"before this run: {instruction}", file=sys.stderr)
    result = record(rig, checked, experiment, out, fetch=fetch)
    print(json.dumps(result) if as_json else text_of(result))
    if result["ending"]["fault"]:
        print(f"error: {result['ending']['sentence']}", file=sys.stderr)
    return status_of(result)


def status_of(result: Table) -> int:
    """The exit status of a run's result."""
    if result["ending"]["fault"]:
        return _DEVICE_FAILED
    return _SAMPLES_LOST if result["ledger"]["lost"] else _DONE


def record(rig: Path, checked: Rig, experiment: Path, out: Path, *, fetch: bool = False) -> Table:
    """One run of an experiment file to one recording; what came of it, as ``--json`` prints it. Shows progress; Ctrl-C ends the run.

    fetch  brings the recording here, to ``out``, if it is made in a daemon's folder
    """
    server = server_of(rig, checked)
    try:
        folder = server.ask("status").get("recordings")
        place = _place(out, folder, fetch)
        if folder is not None and fetch and out.exists():
            raise InputError(out, "exists already, and no recording is overwritten; give another name")
        result = _record(server, rig, experiment, place, remote=folder is not None)
        if folder is not None:
            result |= {"endpoint": checked.zenoh.endpoint, "fetched": None}
            if fetch and isinstance(server, RemoteServer):
                result["fetched"] = bring(server.session, server.keys, place.name, out)["file"]
        return result
    finally:
        server.close()


def _place(out: Path, folder: str | None, fetch: bool) -> Path:
    """Where the recording is made, as the server sees it."""
    if folder is None:
        return out.absolute()
    if not fetch and out.name != str(out):
        raise InputError(
            out,
            f"this daemon records to its own folder, {folder}: give a plain name, or --fetch to bring the file here",
        )
    return Path(folder) / out.name


def _record(server: RigServer, rig: Path, experiment: Path, place: Path, *, remote: bool) -> Table:
    """The result of the run, whose file is at ``place``, or there on a ``remote`` machine. Ctrl-C and SIGTERM end it with the rows so far."""
    stop: list[int] = []
    server.ask(
        "arm",
        {
            "experiment": read_text(experiment),
            "experiment_file": str(experiment),
            "out": place.name if remote else str(place),
            "rig_sha256": hashlib.sha256(read_file(rig)).hexdigest(),
        },
    )
    before = {number: signal.signal(number, lambda n, _: stop.append(n)) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        server.ask("start")
        with _progress() as show:
            while (status := server.ask("status"))["state"] != "idle":
                if stop:
                    server.ask("stop")
                show(status["run"])
                server.wait()
    except DeviceFault as fault:
        if fault.device == "daemon":
            raise DeviceFault("daemon", f"{fault.what}{_left(place, remote)}") from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    result: Table = status["last"]
    return result


def _left(place: Path, remote: bool) -> str:
    """What a daemon that went away has left, as far as it can be seen from here."""
    active = place.with_name(place.name + ".active")
    if remote:
        return f"; what it recorded is on its machine, {place} or {active}"
    if active.exists():
        return f"; what it recorded is in {active}: 'armscope recover'"
    return f"; it finished {place} before it ended: 'armscope info'" if place.exists() else ""


@contextmanager
def _progress() -> Iterator[Callable[[Table], None]]:
    """Shows how far the run is, on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    counts = TextColumn("{task.fields[rows]} rows, {task.fields[lost]} lost")
    columns = (TextColumn("recording"), BarColumn(), counts, TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0, rows=0, lost=0)
        yield lambda run: bar.update(task, completed=run["progress"] or 0.0, rows=run["rows"], lost=run["lost"])


def text_of(result: Table) -> str:
    """The result of a run for a person."""
    ledger, ending = result["ledger"], result["ending"]
    lost = f"{ledger['lost']} of {ledger['triggers']} rows were LOST" if ledger["lost"] else "nothing was lost"
    lines = [f"{result['file']}: {result['rows']} rows of '{result['experiment']}'; {lost}"]
    for loss in ledger["losses"]:
        detail = f" ({loss['detail']})" if loss["detail"] else ""
        lines.append(f"  lost: {loss['rows']} from trigger {loss['first']} on: {loss['sentence']}{detail}")
    lines.append(f"  ended because {ending['sentence']}")
    if result.get("fetched"):
        lines.append(f"  brought to {result['fetched']}")
    elif "fetched" in result:
        lines.append(f"  it lies at the daemon on {result['endpoint']}: 'armscope fetch' brings it")
    return "\n".join(lines + [f"  note: {note}" for note in result["notes"]])
