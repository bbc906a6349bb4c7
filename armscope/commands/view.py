"""``armscope view``: live view for Foxglove and PlotJuggler, of a running daemon or of a recording."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError
from arm_model.collision import read_chain
from armscope.animation import chain_in
from armscope.commands.options import ReadyJson
from armscope.shipped import shipped_folder
from daq.recording import open_long
from daq.rig import chain_of, read_rig
from daq.service import Columns, LiveView, Subscriber, blocks_of, keys_of, open_session, paced

MAY_BE_INFINITE = ("--speed",)


def command(
    source: Annotated[
        Path, typer.Argument(metavar="RIG.toml|RUN.mcap", help="a rig whose daemon runs, or a recording")
    ],
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="port of the WebSocket on 127.0.0.1; 0: any free port")
    ] = 8765,
    speed: Annotated[float, typer.Option(metavar="X", help="speed of a recording relative to real time")] = 1.0,
    as_json: ReadyJson = False,
) -> None:
    if not speed > 0:
        raise InputError("--speed", f"must be above 0 (is {speed:g})")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if source.suffix == ".toml":
        rig = read_rig(source, drivers=False)
        joints = [joint.name or f"joint{number}" for number, joint in enumerate(rig.joint, 1)]
        with open_session(rig, listen=False) as session, Subscriber(session, keys_of(rig.name), latest=20) as rows:
            view = LiveView(rig.name, joints, port=port, chain=chain_of(rig, read_chain))
            _show(rig.name, view, _live(rows), as_json)
    else:
        recording = open_long(source, damaged=True)
        blocks = (block for _, block in paced(blocks_of(recording), speed))
        view = LiveView(str(source), recording.layout.joints, port=port, chain=chain_in(recording))
        for columns in islice(blocks, 1):
            view.show(columns)  # its topics are there before viewers learn the address
        _show(str(source), view, blocks, as_json)


def _live(subscriber: Subscriber) -> Iterator[Columns]:
    while True:
        block = subscriber.receive(1.0)
        if block is not None and block.rows:
            yield block.columns


def _show(name: str, view: LiveView, blocks: Iterator[Columns], as_json: bool) -> None:
    layouts = {kind: str(shipped_folder() / f"views/{kind}") for kind in ("foxglove.json", "plotjuggler.xml")}
    address = f"ws://127.0.0.1:{view.port}"
    if as_json:
        print(json.dumps({"source": name, "address": address, "layouts": layouts}), flush=True)
    print(
        f"showing {name} on {address}: open it in Foxglove ({layouts['foxglove.json']}) or in "
        f"PlotJuggler's Foxglove bridge ({layouts['plotjuggler.xml']}); Ctrl-C ends it",
        file=sys.stderr,
        flush=True,
    )
    try:
        for columns in blocks:
            view.show(columns)
    except KeyboardInterrupt:
        pass
    finally:
        view.close()
