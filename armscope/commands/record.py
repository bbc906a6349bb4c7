"""``armscope record``: one experiment to one file, through a running daemon or with an embedded one."""

from __future__ import annotations

import hashlib
import json
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Protocol

import typer

from arm_io import DeviceFault, InputError
from daq.rig.rig_file import Rig, read_rig
from daq.service.client import call
from daq.service.rig_lock import holder_of
from daq.service.zenoh_session import keys_of, open_session
from experiment import read_experiment

Table = dict[str, Any]
_DONE, _DEVICE_FAILED, _SAMPLES_LOST = 0, 3, 4
_WAIT = 0.05


class Server(Protocol):
    """Who records: a daemon elsewhere, or ourselves."""

    def ask(self, verb: str, arguments: Table | None = None) -> Table: ...
    def wait(self) -> None: ...
    def close(self) -> None: ...


def command(
    rig: Annotated[Path, typer.Option(metavar="RIG.toml", help="the rig")],
    experiment: Annotated[Path, typer.Option(metavar="EXP.toml", help="the motion")],
    out: Annotated[Path, typer.Option(metavar="RUN.mcap", help="the recording to write")],
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> int:
    checked = read_rig(rig, drivers=False)
    instruction = read_experiment(experiment).setup.instruction
    if instruction:
        print(f"before this run: {instruction}", file=sys.stderr)
    result = record(rig, checked, experiment, out)
    print(json.dumps(result) if as_json else _text(result))
    if result["ending"]["fault"]:
        print(f"error: {result['ending']['sentence']}", file=sys.stderr)
        return _DEVICE_FAILED
    return _SAMPLES_LOST if result["ledger"]["lost"] else _DONE


def record(rig: Path, checked: Rig, experiment: Path, out: Path) -> Table:
    """One run of an experiment file to one recording; what came of it, as ``--json`` prints it. Shows progress; Ctrl-C ends the run."""
    server = _server(rig, checked)
    try:
        return _record(server, rig, experiment, out)
    finally:
        server.close()


def _record(server: Server, rig: Path, experiment: Path, out: Path) -> Table:
    """The result of the run. Ctrl-C and SIGTERM end it with the rows so far."""
    stop: list[int] = []
    server.ask(
        "arm",
        {
            "experiment": experiment.read_text(encoding="utf-8"),
            "experiment_file": str(experiment),
            "out": str(out.absolute()),
            "rig_sha256": hashlib.sha256(rig.read_bytes()).hexdigest(),
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
        active = out.absolute().with_name(out.name + ".active")
        if fault.device == "daemon" and active.exists():
            raise DeviceFault("daemon", f"{fault.what}; what it recorded is in {active}: 'armscope recover'") from None
        if fault.device == "daemon" and out.exists():
            raise DeviceFault(
                "daemon", f"{fault.what}; it finished {out.absolute()} before it ended: 'armscope info'"
            ) from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    result: Table = status["last"]
    return result


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


def _server(rig: Path, checked: Rig) -> Server:
    holder = holder_of(checked.name)
    if holder is not None and holder.role == "record":
        raise InputError(rig, f"rig '{checked.name}' is recording now (process {holder.pid}); one run at a time")
    if holder is not None or not checked.zenoh.loopback:
        return _Daemon(checked)
    return _Embedded(rig)


class _Daemon:
    """A daemon that answers on the rig's endpoint."""

    def __init__(self, rig: Rig) -> None:
        self._session, self._keys = open_session(rig, listen=False), keys_of(rig.name)

    def ask(self, verb: str, arguments: Table | None = None) -> Table:
        return call(self._session, self._keys, verb, arguments, timeout=30.0)

    def wait(self) -> None:
        time.sleep(_WAIT)

    def close(self) -> None:
        self._session.close()


class _Embedded:
    """A service of our own, for the time of one recording."""

    def __init__(self, rig: Path) -> None:
        from daq.service.service import Service

        self._service = Service(rig, role="record", publish="welcome")
        self._service.open()
        for note in self._service.notes:
            print(f"note: {note}", file=sys.stderr)

    def ask(self, verb: str, arguments: Table | None = None) -> Table:
        return self._service.obey(verb, arguments or {})

    def wait(self) -> None:
        self._service.step(_WAIT)
        if self._service.bug is not None:
            raise self._service.bug

    def close(self) -> None:
        self._service.close()


def _text(result: Table) -> str:
    ledger, ending = result["ledger"], result["ending"]
    lost = f"{ledger['lost']} of {ledger['triggers']} rows were LOST" if ledger["lost"] else "nothing was lost"
    lines = [f"{result['file']}: {result['rows']} rows of '{result['experiment']}'; {lost}"]
    for loss in ledger["losses"]:
        detail = f" ({loss['detail']})" if loss["detail"] else ""
        lines.append(f"  lost: {loss['rows']} from trigger {loss['first']} on: {loss['sentence']}{detail}")
    lines.append(f"  ended because {ending['sentence']}")
    return "\n".join(lines + [f"  note: {note}" for note in result["notes"]])
