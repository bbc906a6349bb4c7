"""``armscope view``: live view for Foxglove and PlotJuggler, of a running daemon or of a recording."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arm_io import InputError
from arm_model.collision import read_chain
from armscope.animation import chain_in
from armscope.shipped import shipped_folder
from daq.recording import open_long
from daq.rig import chain_of, read_rig
from daq.service import Columns, LiveView, Subscriber, blocks_of, keys_of, open_session, paced

if TYPE_CHECKING:
    from arm_clearance import Chain

MAY_BE_INFINITE = ("--speed",)


def command(
    source: Annotated[
        Path, typer.Argument(metavar="RIG.toml|RUN.mcap", help="a rig whose daemon runs, or a recording")
    ],
    port: Annotated[int, typer.Option(help="port of the WebSocket on 127.0.0.1; 0: any free port")] = 8765,
    speed: Annotated[float, typer.Option(metavar="X", help="speed of a recording relative to real time")] = 1.0,
) -> None:
    if not speed > 0:
        raise InputError("--speed", f"must be above 0 (is {speed:g})")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if source.suffix == ".toml":
        rig = read_rig(source, drivers=False)
        joints = [joint.name or f"joint{number}" for number, joint in enumerate(rig.joint, 1)]
        with open_session(rig, listen=False) as session, Subscriber(session, keys_of(rig.name), latest=20) as rows:
            _show(rig.name, joints, port, _live(rows), chain_of(rig, read_chain))
    else:
        recording = open_long(source, damaged=True)
        blocks = (block for _, block in paced(blocks_of(recording), speed))
        _show(str(source), recording.layout.joints, port, blocks, chain_in(recording))


def _live(subscriber: Subscriber) -> Iterator[Columns]:
    while True:
        block = subscriber.receive(1.0)
        if block is not None and block.rows:
            yield block.columns


def _show(
    name: str, joints: list[str] | tuple[str, ...], port: int, blocks: Iterator[Columns], chain: Chain | None
) -> None:
    layouts = shipped_folder() / "views"
    view = LiveView(name, joints, port=port, chain=chain)
    print(
        f"showing {name} on ws://127.0.0.1:{view.port}: open it in Foxglove ({layouts / 'foxglove.json'}) or in "
        f"PlotJuggler's Foxglove bridge ({layouts / 'plotjuggler.xml'}); Ctrl-C ends it",
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
