"""``armscope page``: the control room of a rig in a browser."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Annotated

import typer

from arm_io import DeviceFault, make_folder
from arm_page import Page
from armscope.api.reading import note_gaps
from armscope.commands.options import ReadyJson, RigArgument
from armscope.display import has_display
from armscope.page_analyses import ANALYSES
from armscope.shipped import shipped_folder
from armscope.starter import Attached, start_attached, when_starter_ends
from daq.rig import Rig, read_rig
from daq.service import holder_of


def command(
    rig: RigArgument,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="port; 0: any free port; default: as the rig file says, 8700")
    ] = None,
    recordings: Annotated[
        Path, typer.Option(metavar="DIR", help="folder for recordings, and for results below it")
    ] = Path("recordings"),
    experiments: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="folder of experiments to choose from; default: those beside the rig file"),
    ] = None,
    browser: Annotated[bool, typer.Option(help="open the page where there is a display")] = True,
    as_json: ReadyJson = False,
    attached: Attached = False,
) -> None:
    checked = read_rig(rig, drivers=False)
    if _needs_daemon(checked):
        read_rig(rig)  # refuses here what its daemon would refuse
    note_gaps(checked.model_path, "picture", *(["collisions"] if checked.space else []))
    page = Page(
        rig=rig,
        recordings=recordings,
        experiments=experiments or [rig.parent / "experiments", rig.parent, shipped_folder() / "experiments"],
        analyses=ANALYSES,
        port=port,
    )
    make_folder(recordings)
    if attached:
        when_starter_ends(lambda: os.kill(os.getpid(), signal.SIGTERM))
    with _daemon(rig, checked):
        page.serve(lambda steer, watch: _ready(checked.name, steer, watch, browser=browser, as_json=as_json))


def _ready(name: str, steer: str, watch: str, *, browser: bool, as_json: bool) -> None:
    if as_json:
        print(json.dumps({"rig": name, "steer": steer, "watch": watch}), flush=True)
    if steer == watch:
        print(f"armscope page: rig {name}: {watch} (with a password); Ctrl-C ends it", file=sys.stderr, flush=True)
    else:
        print(f"armscope page: rig {name}; to steer: {steer}", file=sys.stderr)
        print(f"armscope page: to watch only: {watch}; Ctrl-C ends it", file=sys.stderr, flush=True)
    if browser and has_display():
        webbrowser.open(steer)


def _needs_daemon(rig: Rig) -> bool:
    """Whether the rig is of this machine and no daemon serves it."""
    return holder_of(rig.name) is None and rig.zenoh.loopback


@contextmanager
def _daemon(path: Path, rig: Rig) -> Iterator[None]:
    """The daemon of the rig: the one that runs, or, for a rig of this machine, one for the time of the page."""
    if not _needs_daemon(rig):
        yield
        return
    process = start_attached(["daemon", "--rig", str(path)], stderr=subprocess.PIPE)
    assert process.stderr is not None
    line = process.stderr.readline()
    if "is open" not in line:
        process.kill()
        raise DeviceFault("daemon", line.removeprefix("error: ").strip() or "did not start")
    print(line.rstrip(), file=sys.stderr)
    threading.Thread(target=_pass_on, args=(process.stderr,), daemon=True).start()
    try:
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def _pass_on(lines: IO[str]) -> None:
    """What the daemon says, to our own standard error."""
    for line in lines:
        print(line.rstrip(), file=sys.stderr, flush=True)
