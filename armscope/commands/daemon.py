"""``armscope daemon``: the service of one rig."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import Annotated

import typer

from arm_io import make_folder
from arm_model.collision import read_chain
from armscope.commands.options import ReadyJson, RigOption
from armscope.starter import Attached, start_attached, when_starter_ends
from daq.service import Service


def command(
    rig: RigOption,
    recordings: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="the only folder into which recordings are written; required if the rig's endpoint is not loopback",
        ),
    ] = None,
    page: Annotated[
        bool, typer.Option("--page", help="serve the page of the rig too, as 'armscope page' does")
    ] = False,
    as_json: ReadyJson = False,
    attached: Attached = False,
) -> None:
    if recordings is not None:
        make_folder(recordings)
    service = Service(rig, folder=recordings, read_chain=read_chain)
    told_to_end = []

    def end(number: int, _: object) -> None:
        told_to_end.append(number)
        service.wake()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)
    if attached:
        when_starter_ends(lambda: end(signal.SIGTERM, None))
    service.open()
    shown = None
    try:
        _say(f"rig {service.rig.name} is open on {service.rig.zenoh.endpoint}; Ctrl-C or SIGTERM ends it")
        if as_json:
            opened = {"rig": service.rig.name, "endpoint": service.rig.zenoh.endpoint, "pid": os.getpid()}
            print(json.dumps(opened), flush=True)
        # A process of its own: what it draws takes no time from the sampler, and may fail without it.
        shown = start_attached(["page", str(rig)]) if page else None
        while not told_to_end:
            service.step(1.0)
            if service.lifecycle.bug is not None:
                traceback.print_exception(service.lifecycle.bug)
                service.lifecycle.bug = None
    finally:
        if shown is not None:
            shown.terminate()
        service.close()
        if shown is not None:
            shown.wait()
    _say(f"rig {service.rig.name} is closed")


def _say(line: str) -> None:
    # Who started it, and read its standard error, may be gone.
    with contextlib.suppress(OSError):
        print(f"armscope daemon: {line}", file=sys.stderr, flush=True)
